"""A scene's own kernels, compiled beside or after its render by a process of low priority, while others stand in."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from typing import Final

from wdpm.cluster.master.local_slaves import SlaveProcess
from wdpm.kernels.cached import cache_folder, remove_half_made
from wdpm.kernels.features import Features
from wdpm.rendering import compile_beside
from wdpm.rendering.compiling import Compiling

GRACE_S = 5.0
"""How long a process that was killed may take to be gone [s]."""

HEAD_START_S = 20.0
"""How long a render goes on before its kernels are compiled beside it [s]. Most are over by then: a compiler would only
have taken a core from them, for some 20 s. Own kernels save a quarter of what is left at best."""

LEFT = (
    "kernels for just the effects of this scene are now compiled beside other work, for its next renders, for some "
    "seconds (--compile no: never)"
)

_left: Final[list[SlaveProcess]] = []
"""Processes that compile on after their renders: they are ours to the end of this process, which waits for none."""


class KernelsBeside:
    """At most one process that compiles.

    It ends with this one, however that ends, unless the render was done and it was left to go on.

    Args:
        when: whether there is any; BESIDE.
        clock: of seconds.
    """

    def __init__(self, when: Compiling, clock: Callable[[], float] = time.monotonic) -> None:
        self._wanted = when is Compiling.BESIDE
        self._clock = clock
        self._began: float | None = None
        self._features: list[Features] = []
        self._process: SlaveProcess | None = None
        self._tell: Callable[[str], None] = lambda _: None

    @property
    def running(self) -> bool:
        """Whether there is one."""
        return self._process is not None and self._process.ended() is None

    def compile(self, features: Sequence[Features], tell: Callable[[str], None]) -> None:
        """Have the kernels of these compiled, in this order, and before those of earlier calls.

        Args:
            tell: is told if they are still compiled when the render is done.
        """
        self._tell = tell
        if self._wanted and features:
            self._features = list(dict.fromkeys([*features, *self._features]))
            if self._began is None:
                self._began = self._clock()

    def before_pass(self) -> None:
        """Begin, if the render has lasted so long that others of its passes may gain by it."""
        if self._began is not None and self._clock() - self._began >= HEAD_START_S and self._has_to_begin():
            self._begin()

    def leave(self) -> None:
        """The render is done: what is not compiled yet is, after this process, too, for renders to come."""
        if self._has_to_begin():
            self._begin()
        self._features = []
        if self._process is not None:
            process, self._process = self._process, None
            if process.ended() is None:
                self._tell(LEFT)
            process.leave(compile_beside.GO_ON)
            _left.append(process)

    def stop(self) -> None:
        """End it, whatever it is at, and what it has left half made; may be called again."""
        self._features = []
        if self._process is not None:
            process, self._process = self._process, None
            process.kill()
            process.stop(GRACE_S)
            remove_half_made(process.number)

    def _has_to_begin(self) -> bool:
        """Whether there is something to compile, and nobody who does, or has."""
        refused = self._process is not None and self._process.exit_code == compile_beside.BUSY
        return bool(self._features) and (self._process is None or refused)

    def _begin(self) -> None:
        if self._process is not None:
            self._process.stop(GRACE_S)
        words = [",".join(each.names()) for each in self._features]
        self._process = SlaveProcess([sys.executable, "-m", compile_beside.__name__, str(cache_folder()), *words])
