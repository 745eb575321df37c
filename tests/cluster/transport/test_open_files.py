"""How many files and sockets a process may open is known before a render, not when ZeroMQ ends it."""

from __future__ import annotations

import sys

import pytest

from wdpm.cluster.limits import MOST_SLAVES
from wdpm.cluster.master.server import MasterServer
from wdpm.cluster.transport import open_files
from wdpm.scenes.errors import SettingsError

if sys.platform == "win32":
    pytest.skip("Windows has no such limit", allow_module_level=True)

import resource


class Limit:
    """A soft and a hard limit, in place of this process's."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, soft: int, hard: int) -> None:
        self.soft, self.hard = soft, hard
        monkeypatch.setattr(resource, "getrlimit", lambda _: (self.soft, self.hard))
        monkeypatch.setattr(resource, "setrlimit", self._set)

    def _set(self, _: int, limits: tuple[int, int]) -> None:
        assert limits[1] == self.hard
        assert limits[0] <= self.hard or self.hard == resource.RLIM_INFINITY
        self.soft = limits[0]


@pytest.mark.parametrize("hard", [4096, resource.RLIM_INFINITY])
def test_a_limit_that_may_be_raised_is(monkeypatch: pytest.MonkeyPatch, hard: int) -> None:
    limit = Limit(monkeypatch, 1024, hard)
    open_files.require(8)
    assert limit.soft == 1024
    open_files.require(MOST_SLAVES)
    assert limit.soft == open_files.needed(MOST_SLAVES)


def test_no_limit_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    Limit(monkeypatch, resource.RLIM_INFINITY, resource.RLIM_INFINITY)
    assert open_files.allow(MOST_SLAVES) is None
    open_files.require(MOST_SLAVES)


def test_a_slave_goes_as_far_as_it_may(monkeypatch: pytest.MonkeyPatch) -> None:
    Limit(monkeypatch, 64, 500)
    assert open_files.allow(MOST_SLAVES) == 500


def test_a_master_that_may_open_too_few_does_not_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    Limit(monkeypatch, 64, 64)
    with pytest.raises(SettingsError, match=r"20 slaves: .* may open 64 .* up to 120: .*ulimit -n 120"):
        MasterServer("memory://master", 20)
