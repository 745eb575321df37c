"""Hosts as people name them, and those that would be options or commands."""

from __future__ import annotations

import pytest

from wdpm.placing.hosts import Host, read_hosts
from wdpm.scenes.errors import SettingsError


def test_hosts() -> None:
    words = ["anna", "bert:2", "me@host-3.example.org:16", "10.0.0.7", "[fe80::1]:2", "me@[::1]"]
    assert read_hosts(words) == (
        Host("anna"),
        Host("bert", 2),
        Host("me@host-3.example.org", 16),
        Host("10.0.0.7"),
        Host("fe80::1", 2),
        Host("me@::1"),
    )


@pytest.mark.parametrize(
    "word",
    [
        *("", "-oProxyCommand=ls", "-a@b", "a@-b", "a b", "a;ls", "$(ls)", "a'b", "a\n", "é"),
        *("a:0", "a:-1", "a:1000", "a:b", ":2", "a@", "@a", "a@b@c", "fe80::1", "[a]:2", "[-1::]x"),
    ],
)
def test_what_is_no_host(word: str) -> None:
    with pytest.raises(SettingsError, match="is no host: expected"):
        read_hosts([word])


def test_no_host_at_all() -> None:
    with pytest.raises(SettingsError, match="no host is named"):
        read_hosts([])
