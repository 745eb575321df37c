"""Codecs that are made ahead: all that messages are made of, and whatever refers to itself."""

from __future__ import annotations

from dataclasses import dataclass

from wdpm.cluster.messages import packing, protocol


@dataclass(frozen=True)
class Branch:
    branches: tuple[Branch, ...]
    names: dict[str, Branch | None]


def test_nothing_of_a_message_is_left_to_be_found_out() -> None:
    packing.prepare(protocol.Message)
    known = packing._hints.cache_info().misses
    for message in packing.by_name(protocol.Message).values():
        packing._hints(message)
    assert packing._hints.cache_info().misses == known


def test_what_is_of_its_own_kind_somewhere_within() -> None:
    packing.prepare(Branch)
    assert set(packing._hints(Branch)) == {"branches", "names"}
