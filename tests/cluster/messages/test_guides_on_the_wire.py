"""Guides to caustics that travel: what holds together arrives as it was sent, the rest is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from wdpm.cluster.guide import CausticGuide
from wdpm.cluster.messages.guide_checks import check_caustic_guide
from wdpm.scenes.errors import ProtocolError

GUIDE = CausticGuide(
    np.zeros(1, np.int32),
    np.zeros(1, np.float32),
    np.array([0, 1, 3], np.int32),
    np.zeros((3, 3), np.float32),
    np.array([0.5, 1.0, 1e-6], np.float32),
    np.array([1.0, 0.25, 0.75], np.float32),
    np.array([0.1, 0.5], np.float32),
)


def test_a_guide_that_holds_together_passes() -> None:
    check_caustic_guide(GUIDE, "guide")
    none = np.array([0, 0, 3], np.int32)  # a region without lobes
    check_caustic_guide(replace(GUIDE, first=none, share=np.array([0.5, 0.25, 0.25], np.float32)), "guide")


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"part": np.array([0.1, 1.0], np.float32)}, "a part is not"),
        ({"part": np.array([-0.1, 0.5], np.float32)}, "a part is not"),
        ({"part": np.array([0.1], np.float32)}, "not one for each region"),
        ({"axis": np.array([3], np.int32)}, "axis is 3"),
        ({"axis": np.zeros(2, np.int32)}, "2 regions, 2 planes"),
        ({"split": np.array([np.nan], np.float32)}, "a plane or a target"),
        ({"target": np.full((3, 3), np.inf, np.float32)}, "a plane or a target"),
        ({"first": np.array([0, 4, 3], np.int32)}, "do not follow"),
        ({"first": np.array([1, 1, 3], np.int32)}, "do not follow"),
        ({"first": np.array([0, 1, 2], np.int32)}, "do not follow"),
        ({"first": np.array([0, -1, 3], np.int32)}, "do not follow"),
        (
            {
                "first": np.empty(0, np.int32),
                "axis": np.empty(0, np.int32),
                "split": np.empty(0, np.float32),
                "part": np.empty(0, np.float32),
            },
            "of no",
        ),
        ({"rim": np.array([0.0, 1.0, 1.0], np.float32)}, "wider than a hemisphere"),
        ({"rim": np.array([0.5, 1.5, 1.0], np.float32)}, "wider than a hemisphere"),
        ({"rim": np.array([0.5, np.nan, 1.0], np.float32)}, "wider than a hemisphere"),
        ({"share": np.array([1.0, -0.25, 1.25], np.float32)}, "between 0 and 1"),
        ({"share": np.array([1.0, 0.25, 0.25], np.float32)}, "not 1 together"),
    ],
)
def test_a_guide_that_does_not_is_refused(changes: dict[str, Any], reason: str) -> None:
    with pytest.raises(ProtocolError, match=reason):
        check_caustic_guide(replace(GUIDE, **changes), "guide")
