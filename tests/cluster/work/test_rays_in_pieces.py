"""Rays that a home starts in its own cells wait with those of others, in pieces, where others hold cells too."""

from __future__ import annotations

from unittest import mock

import pytest

from wdpm.cluster.batch import TO_HOME, Batch, Kind
from wdpm.cluster.outbox import Outbox
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.cluster.work import worker
from wdpm.cluster.work.worker import CellWorker
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes import cornell_box

SETTINGS = RenderSettings(photons=2000, spp=2, indirect=Indirect.CACHE)


@pytest.mark.parametrize("most", [7, 1 << 30])
def test_no_bit_depends_on_how_large_pieces_are(most: int) -> None:
    put_off: list[int] = []
    original = CellWorker._put_off

    def watched(self: CellWorker, batch: Batch, outbox: Outbox) -> None:
        before = len(outbox.batches)
        original(self, batch, outbox)
        made = outbox.batches[before:]
        assert batch.kind not in TO_HOME
        together = int(batch.arrays["together"].max()) if batch.kind is Kind.START else 0
        assert all(len(piece) <= max(most, together) for piece in made)
        assert sum(map(len, made)) == len(batch)
        assert sum(piece.credit for piece in made) == batch.credit
        put_off.append(len(made))

    scene = cornell_box((12, 12))
    with mock.patch.object(CellWorker, "_put_off", watched), mock.patch.object(worker, "PIECE_ROWS", most):
        alone = render_in_process(scene, SETTINGS, workers=1, threads=1)
        assert not put_off, "nobody waits for one who has all cells"
        divided = render_in_process(scene, SETTINGS, workers=3, threads=1)
    assert divided.digest() == alone.digest()
    assert put_off
    assert max(put_off) > 1 or most > 7


def test_what_waits_when_the_image_is_done_is_no_negative_count() -> None:
    """A task that was handed out twice: another worker was faster, and rays put off here never came in."""
    counts = dict.fromkeys(("rays_in", "rays_out", "bytes_in", "bytes_out"), 5)
    there = mock.Mock(_traffic={**counts, "rays_put_off": 3, "bytes_put_off": 9})
    assert CellWorker._travelled(there) == {**counts, "rays_in": 2, "bytes_in": 0}
