"""Whatever Mitsuba scenes lie in the folder that WDPM_FOREIGN_SCENES names: they look as Mitsuba's own image does."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from against_mitsuba import NotReadError, compare

pytestmark = pytest.mark.foreign

FOLDER = os.environ.get("WDPM_FOREIGN_SCENES")
LARGEST = 0.01
"""Share by which the mean of a channel may be off, besides four deviations of Mitsuba's own noise."""


def scenes() -> list[Path]:
    """Files that have a camera; others are parts, which those include."""
    files = sorted(Path(FOLDER).rglob("*.xml")) if FOLDER else []
    return [file for file in files if "<sensor" in file.read_text(errors="replace")] or [Path("none")]


@pytest.mark.parametrize("file", scenes(), ids=str)
def test_means_are_mitsubas(file: Path) -> None:
    pytest.importorskip("mitsuba")
    try:
        compared = compare(file, variant=os.environ.get("WDPM_MITSUBA_VARIANT", "scalar_rgb"))
    except NotReadError as error:
        pytest.skip(f"Mitsuba does not read it: {error}")
    assert (abs(compared.off) <= LARGEST + 4.0 * compared.noise).all(), f"{compared.off} +- {compared.noise}"
