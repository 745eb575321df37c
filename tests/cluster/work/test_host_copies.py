"""What is copied between host and device for a batch: what docs/gpu.md lists; and nothing rests on shared memory."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from separate_memory import Ledger, separate_memory

from wdpm.bench import effects_scenes
from wdpm.bench.gpu.device_check import FEW
from wdpm.cluster.render_settings import Indirect, Integrator, Routing
from wdpm.rendering.in_process import render_in_process

PAGE = Path(__file__).resolve().parents[3] / "docs" / "gpu.md"
WAYS: tuple[dict[str, Any], ...] = (
    {"indirect": Indirect.CACHE, "routing": Routing.MERGE},
    {"integrator": Integrator.PATH, "routing": Routing.FORWARD},
)
"""Between them they have batches of all kinds that a cell computes."""

OTHER_WAYS: tuple[dict[str, Any], ...] = (
    {"indirect": Indirect.MAP},
    {"indirect": Indirect.GATHER},
    {"indirect": Indirect.CACHE},
)


def listed() -> dict[str, tuple[int, int]]:
    """Most copies of a batch, up and down, by kind, as the page lists them."""
    rows = re.findall(r"^\| `(\w+)` \| (\d+) \| (\d+) \|", PAGE.read_text(), re.MULTILINE)
    return {kind: (int(up), int(down)) for kind, up, down in rows}


def copied(way: dict[str, Any]) -> Ledger:
    """What a small render with all effects copies; it is checked to be the image that it is with shared memory."""
    scene = effects_scenes.scene_of(effects_scenes.EVERYTHING, (12, 9))
    few = {"spp": 1, "photons": 1000, "caustic_photons": 500, "volume_photons": 500, "all_effects": True}
    settings = replace(FEW, **few, **way)
    shared = render_in_process(scene, settings, workers=2, cells=4, threads=1)
    with separate_memory() as ledger:
        separate = render_in_process(scene, settings, workers=2, cells=4, threads=1)
    assert separate.digest() == shared.digest()
    return ledger


def check(ledger: Ledger) -> set[str]:
    """Hold what was copied against the page; the kinds of batches that anything was copied for."""
    most = listed()
    kinds = {kind for kind in ledger.batches if ledger.most(kind) != (0, 0)}
    for kind in kinds:
        up, down = ledger.most(kind)
        assert up <= most[kind.value][0], kind
        assert down <= most[kind.value][1], kind
    return {kind.value for kind in kinds}


def test_no_batch_is_copied_more_often_than_the_page_says() -> None:
    assert set.union(*(check(copied(way)) for way in WAYS)) == listed().keys()


@pytest.mark.slow
@pytest.mark.parametrize("way", OTHER_WAYS, ids=lambda way: way["indirect"].value)
def test_nor_with_other_light(way: dict[str, Any]) -> None:
    assert check(copied(way)) <= listed().keys()


def test_copies_are_counted_and_real() -> None:
    numbers = np.arange(6, dtype=np.float32)
    with separate_memory() as ledger:
        array = wp.array(numbers, dtype=wp.float32, device="cpu", copy=False)
        back = array.numpy()
        numbers[0], back[1] = 7.0, 8.0
        assert array.numpy().tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert vars(ledger.total) == {"up": 1, "down": 2, "bytes_up": 24, "bytes_down": 48}


def test_memory_is_shared_again_afterwards() -> None:
    with separate_memory():
        pass
    numbers = np.zeros(3, np.float32)
    array = wp.array(numbers, dtype=wp.float32, device="cpu", copy=False)
    array.numpy()[0] = 5.0
    assert numbers[0] == 5.0
