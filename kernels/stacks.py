"""Stacks of the threads that run kernels: where one is too small, the process ends without a word of its own.

A shell, a container or a scheduler may bound them (`ulimit -s`). A soft limit is raised; threads, whose stacks Linux
makes as large as that limit was when the process began, are given larger ones.
"""

from __future__ import annotations

import threading

from wdpm.scenes.errors import MachineError

try:
    import resource
except ModuleNotFoundError:  # POSIX alone has it
    resource = None  # type: ignore[assignment]

NEEDED = 1 << 20
"""Bytes; kernels that build trees crash with a quarter of it."""

USUAL = 8 << 20
"""Bytes that systems allow by default."""


def allow_stacks() -> None:
    """Have stacks large enough for kernels in this thread and those that Python starts from here on.

    Raises:
        MachineError: the system allows none.
    """
    if resource is None:
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_STACK)
    if soft == resource.RLIM_INFINITY or soft >= NEEDED:
        return
    wanted = USUAL if hard == resource.RLIM_INFINITY else min(USUAL, hard)
    if wanted < NEEDED:
        raise MachineError(
            f"the stacks of this process may have {soft >> 10} KiB, and kernels need {NEEDED >> 10}: "
            f"raise that limit (ulimit -s {USUAL >> 10})"
        )
    resource.setrlimit(resource.RLIMIT_STACK, (wanted, hard))
    if not threading.stack_size():
        threading.stack_size(wanted)
