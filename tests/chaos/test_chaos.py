"""A few renders under faults of slaves and links, with real processes. `make chaos` runs hundreds."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from failures import DifferentBits
from page import page
from patience import WAIT_S
from standing import SLAVES, Hung, Outcome, StandingCluster
from strikes import KINDS, Strikes
from trials import Configuration, Rows, Trial, expected

pytestmark = [pytest.mark.sockets, pytest.mark.processes]

WHAT = Configuration("cornell-box", "cache", 1, "forward", "none")
BASE_CPU_S = 1.0
"""Of a render; less than it takes, so that faults come in its course."""
RENDERS = 5


@pytest.fixture(scope="module")
def cluster() -> Iterator[StandingCluster]:
    with StandingCluster() as standing:
        standing.complete()
        assert len(standing.slaves.alive) == SLAVES
        yield standing


def check_bits(outcome: Outcome, what: Configuration) -> None:
    if outcome.digest != expected(*what.picture):
        raise DifferentBits(f"{what}: {outcome}")


def struck_render(cluster: StandingCluster, kind: str, what: Configuration) -> Outcome:
    """Renders until one was struck: where the thread that strikes is given no processor, a render is over before."""
    chance = random.Random(f"{kind} {what.copies}")
    for _ in range(RENDERS):
        strikes = Strikes(cluster, KINDS[kind], chance, BASE_CPU_S)
        cluster.complete()
        with strikes.meanwhile():
            outcome = cluster.render(what, 2 * WAIT_S)
        if strikes.happened:
            return outcome
    raise AssertionError(f"none of {RENDERS} renders was struck")


@pytest.mark.parametrize(("kind", "copies"), [("kill", "auto"), ("kills", "none"), ("term", "none")])
def test_the_bits_survive(cluster: StandingCluster, kind: str, copies: str) -> None:
    what = Configuration(**{**vars(WHAT), "copies": copies, "indirect": "map" if copies == "auto" else "cache"})
    outcome = struck_render(cluster, kind, what)
    check_bits(outcome, what)
    assert outcome.redone == 0


def test_links_that_are_cut_for_a_second() -> None:
    with StandingCluster(KINDS["cut"].link, 2) as linked:
        outcome = struck_render(linked, "cut", WHAT)
        check_bits(outcome, WHAT)
        assert len(linked.slaves.alive) == 2, "it was to join again by itself"


def test_a_render_that_takes_too_long_is_said_to_hang(cluster: StandingCluster) -> None:
    cluster.complete()
    with pytest.raises(Hung, match="not rendered within 0 s"):
        cluster.render(WHAT, 0.0)


def test_rows_are_gone_on_with(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    told = Trial("kill", 0, WHAT, ("SIGKILL at 50%",), 2.0, 3.0, 1.0, 1.0, 2.0, 0, "bits differ")
    Rows(path, resume=False).add(told)
    assert Rows(path, resume=True).of("kill") == [told]
    text = page([told, Trial("kill", 1, WHAT, ("SIGKILL at 1%",), 2.0, 3.0, 1.0, 1.0, 2.0)], 7)
    assert text.startswith("# 1 of 2 renders have the bits of one process (seed 7)")
    assert "| kill | none | 1 | 1.50 | 1.50 | 1.0 | 2.00 | 2.00 | 2.0 |" in text
    assert Rows(path, resume=False).trials == []
