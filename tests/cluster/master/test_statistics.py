"""What a slave may tell of its own time and messages, beside what its worker did (test_master has the rest)."""

from __future__ import annotations

from typing import Any

import pytest
from fake_worker import make_world, statistics_of

from wdpm.cluster.master.statistics import check_statistics
from wdpm.cluster.messages import protocol
from wdpm.scenes.errors import ProtocolError

ACCOUNT: dict[str, Any] = {
    "spent_s": dict.fromkeys(protocol.SPENT, 1.0),
    "messages": {"Ready": 1},
    "batches_by_rays": {"0": 1, "4": 2},
    "batches_by_bytes": {"1024": 3},
}


@pytest.mark.parametrize("account", [{}, ACCOUNT])
def test_a_slave_may_keep_an_account(account: dict[str, Any]) -> None:
    world = make_world(2)
    check_statistics(statistics_of(dropped={}, **account), world)


@pytest.mark.parametrize("name", sorted(ACCOUNT))
def test_it_is_whole(name: str) -> None:
    world = make_world(2)
    rest = {other: value for other, value in ACCOUNT.items() if other != name}
    with pytest.raises(ProtocolError, match=f"without .'{name}'"):
        check_statistics(statistics_of(dropped={}, **rest), world)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("spent_s", {"computing": 1.0}),
        ("spent_s", dict.fromkeys([*protocol.SPENT, "dreaming"], 1.0)),
        ("spent_s", dict.fromkeys(protocol.SPENT, -1.0)),
        ("spent_s", dict.fromkeys(protocol.SPENT, float("inf"))),
        ("spent_s", [1.0]),
        ("messages", {"Ready": -1}),
        ("messages", {1: 1}),
        ("messages", None),
        ("batches_by_rays", {"3": 1}),
        ("batches_by_bytes", {"4": 1.5}),
        ("batches_by_bytes", {4: 1}),
    ],
)
def test_its_figures_are_what_they_should_be(name: str, value: object) -> None:
    world = make_world(2)
    with pytest.raises(ProtocolError, match=f"Statistics: {name} is "):
        check_statistics(statistics_of(dropped={}, **{**ACCOUNT, name: value}), world)
