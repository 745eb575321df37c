"""Grids of heterogeneous media over the wire: they come as they were, and no index of theirs may point outside."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import effect_scenes
import numpy as np
import pytest

from wdpm.cluster.messages.packing import decode, encode
from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.flat.arrays import Media
from wdpm.scenes.flat.flatten import flatten


@dataclass(frozen=True, eq=False)
class Told:
    """A message of media alone."""

    media: Media


MEDIA = flatten(effect_scenes.everything()).media


def sent(media: Media) -> Media:
    told = decode([bytes(frame) for frame in encode(Told(media))], {"Told": Told})
    assert isinstance(told, Told)
    return told.media


def test_grids_come_as_they_were() -> None:
    came = sent(MEDIA)
    assert MEDIA.density_grid.tolist() == came.density_grid.tolist() == [0, 1]
    assert MEDIA.albedo_grid.tolist() == came.albedo_grid.tolist() == [2, -1]
    for field in fields(MEDIA.grids):
        np.testing.assert_array_equal(getattr(came.grids, field.name), getattr(MEDIA.grids, field.name))


def changed(name: str, place: Any, value: float) -> Media:
    array = getattr(MEDIA.grids, name).copy()
    array[place] = value
    return replace(MEDIA, grids=replace(MEDIA.grids, **{name: array}))


BROKEN = {
    "density_grid": replace(MEDIA, density_grid=np.int32([0, 3])),
    "albedo_grid": replace(MEDIA, albedo_grid=np.int32([-2, 0])),
    "a density of more than one channel": replace(MEDIA, density_grid=np.int32([0, 2])),
    "size": changed("size", (0, 1), 0),
    "values; expected": changed("size", (0, 1), 12),
    "channels": changed("channels", 0, 2),
    "nearest": changed("nearest", 0, 2),
    "a place that is not finite": changed("to_lattice", (0, 0, 0), np.nan),
    "a box beyond its lattice": changed("high", (1, 2), 1e3),
    "grids.low has shape": replace(MEDIA, grids=replace(MEDIA.grids, low=MEDIA.grids.low[:2])),
}


@pytest.mark.parametrize("message", list(BROKEN))
def test_broken_grids_are_refused(message: str) -> None:
    with pytest.raises(ProtocolError, match=message):
        sent(BROKEN[message])
