"""A small share of the fuzzer of the wire, and that it notices what it is for. `make fuzz` runs it at length."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence

import fuzz_cells
import fuzz_wire
import msgpack
import pytest
import wire_cluster
from wire_cluster import NOBODY, WireCluster
from wire_mutations import mutate

from wdpm.cluster.master.film import Film
from wdpm.cluster.master.machine import Master
from wdpm.cluster.messages import packing
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.task import BucketRendered

CASES = 15


def failures(cases: int) -> Iterator[str]:
    """One after another: who looks for one need not wait for all."""
    return (failure.message for number in range(cases) for failure in fuzz_wire.run_unmeasured(number)[1])


def test_lies_of_strangers_slaves_and_masters() -> None:
    lies = 0
    for number in range(CASES):
        told, wrong = fuzz_wire.run_unmeasured(number)
        assert wrong == []
        lies += told
    assert lies > 1000


def test_without_lies_there_is_an_image() -> None:
    cluster = WireCluster(random.Random(1), 3, NOBODY, 0.0)
    outcome = cluster.run()
    assert outcome.lies == 0
    assert fuzz_wire.judge(cluster, outcome, fuzz_wire.STRANGER) is None


def test_messages_of_every_kind_are_changed() -> None:
    frames = [bytes(frame) for frame in packing.encode(p.Hello({"code": "1"}, "host", 1, 1, 0, "tcp://a:1"))]
    rng = random.Random(0)
    assert len({tuple(mutate(frames, rng)) for _ in range(500)}) > 300


def test_a_master_that_minds_strangers_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Master, "_unreadable", lambda self, _, reason: self._break(reason))
    assert any("a stranger ended the render" in failure for failure in failures(10))


def test_pixels_in_the_wrong_place_are_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the master; and by the fuzzer, where a master believes that they lie where a slave says."""

    def moved(frames: Sequence[bytes], _: random.Random) -> list[bytes]:
        header = msgpack.unpackb(frames[0])
        if b"BucketRendered" in frames[0]:
            header[3][1][1][1] += 1  # TaskDone.result: [name, [number, x0, ...
        return [msgpack.packb(header), *frames[1:]]

    def put(self: Film, _: object, result: BucketRendered) -> None:
        for name, pixels in result.layers.items():
            width = min(pixels.shape[1], self.layers[name].shape[1] - result.x0)
            rows = slice(result.y0, result.y0 + len(pixels))
            self.layers[name][rows, result.x0 : result.x0 + width] = pixels[:, :width]

    def judged() -> str | None:
        cluster = WireCluster(random.Random(0), 2, 0, 1.0)
        outcome = cluster.run()
        return outcome.broken or fuzz_wire.judge(cluster, outcome, 0)

    monkeypatch.setattr(wire_cluster, "mutate", moved)
    assert "its pixels came for" in str(judged())
    monkeypatch.setattr(Film, "put", put)
    assert "is wrong, and nobody said so" in str(judged())


def test_a_type_that_is_not_checked_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packing, "_unpack_scalar", lambda hint, value, where: value)  # noqa: ARG005
    assert any("a crash" in failure for failure in failures(100))


def test_numbers_of_a_liar_in_real_kernels() -> None:
    assert [failure for number in range(8) for failure in fuzz_cells.run_case(number)[1]] == []


def test_real_slaves_without_lies_have_an_image() -> None:
    cluster = fuzz_cells.CellCluster(random.Random(0), 0, 0.0)
    outcome = cluster.run()
    assert (outcome.broken, outcome.lies) == (None, 0)
    assert outcome.result is not None
