"""Gather rays of records set out in waves, and the records are the same however small those are."""

from __future__ import annotations

from unittest import mock

import numpy as np
import pytest

from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.cluster.work.records import record_home
from wdpm.cluster.work.records.extra_rays import ExtraRays
from wdpm.cluster.work.records.record_wave import RecordWave, further_rays
from wdpm.kernels.launch import ONE_THREAD
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes import cornell_box

SETTINGS = RenderSettings(photons=2000, spp=2, indirect=Indirect.CACHE)


@pytest.mark.parametrize(("cells", "bound"), [(1, "WAVE_RAYS"), (2, "DIVIDED_WAVE_RAYS")])
@pytest.mark.parametrize("most", [30, 100])
def test_no_bit_depends_on_how_many_rays_are_under_way(most: int, cells: int, bound: str) -> None:
    """`most` below a hemisphere's: one record at a time, and its further rays in several waves."""
    waves: list[int] = []
    begin = RecordWave.__init__

    def counted(wave: RecordWave, *args: object) -> None:
        begin(wave, *args)  # type: ignore[arg-type]
        waves.append(len(wave))

    scene = cornell_box((12, 12))
    with mock.patch.object(RecordWave, "__init__", counted):
        whole = render_in_process(scene, SETTINGS, workers=1, cells=cells, threads=1)
        few, rays = len(waves), sum(waves)
        waves.clear()
        with mock.patch.object(record_home, bound, most):
            cut = render_in_process(scene, SETTINGS, workers=1, cells=cells, threads=1)
    assert cut.digest() == whole.digest()
    assert sum(waves) == rays
    assert len(waves) > few
    assert min(waves) <= most


def extra_of(counts: list[list[int]]) -> ExtraRays:
    return ExtraRays.of(np.array(counts), np.array(counts).sum(axis=1))


def test_pieces_of_rays_are_all_of_them() -> None:
    rays = further_rays(ONE_THREAD, extra_of([[0, 2, 1], [3, 0, 0]]), 1, 3)
    pieces = list(rays.cut(4))
    assert [len(piece) for piece in pieces] == [4, 2]
    for name in ("record", "ray", "stratum", "turn"):
        joined = np.concatenate([getattr(piece, name) for piece in pieces])
        assert np.array_equal(joined, getattr(rays, name))
    assert not list(further_rays(ONE_THREAD, extra_of([[0, 0, 0]] * 2), 1, 3).cut(4))
