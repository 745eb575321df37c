"""How many files and sockets this process may have open, of which each connection is one.

ZeroMQ ends a process without a word of its own when it has to open one more (it asserts). So a master finds out before
a render, and a slave before it joins and before it connects with others; and limits that a user may raise himself (soft
ones; mostly 1,024) are raised: 256 slaves need more.
"""

from __future__ import annotations

import contextlib

from wdpm.cluster.limits import MOST_SLAVES
from wdpm.scenes.errors import MachineError, SettingsError

try:
    import resource
except ModuleNotFoundError:  # POSIX alone has it
    resource = None  # type: ignore[assignment]

OWN = 40
"""What a master or slave has open besides: libraries, pipes, kernels, files that it writes."""

EACH = 4
"""For each slave that it talks to: connections both ways, heartbeats, memory that they share."""


def needed(slaves: int) -> int:
    """How many files and sockets a process has open, at most, that takes part in a cluster of so many slaves."""
    return OWN + EACH * slaves


def allow(slaves: int) -> int | None:
    """Raise the limit of this process so far that this number of slaves can be, or as far as it goes.

    Returns:
        The limit; None if there is none.
    """
    if resource is None:
        return None
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = needed(slaves)
    if soft == resource.RLIM_INFINITY:
        return None
    if soft < wanted and soft != hard:
        wanted = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
        with contextlib.suppress(ValueError, OSError):  # where the system has limits of its own beside these
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
            soft = wanted
    return soft


def require(slaves: int) -> None:
    """As `allow`; SettingsError if that is not enough."""
    limit = allow(slaves)
    if limit is not None and limit < needed(slaves):
        raise SettingsError(
            f"{slaves} slave{'s' * (slaves != 1)}: a process may open {limit} files and sockets here, and needs up to "
            f"{needed(slaves)}: raise that limit (ulimit -n {needed(slaves)}), or take fewer slaves"
        )


def require_as_slave(peers: int) -> None:
    """As `allow`, for a slave that is connected with its master and so many others; MachineError if not enough."""
    limit = allow(peers + 1)
    if limit is not None and limit < needed(peers + 1):
        raise MachineError(
            f"a slave may open {limit} files and sockets here, too few to talk to {_others(peers)}: raise that limit "
            f"(ulimit -n {needed(MOST_SLAVES)} is enough for any cluster)"
        )


def _others(peers: int) -> str:
    return "a master" if not peers else f"{peers} other slave{'s' * (peers != 1)}"
