"""A scene's own kernels, compiled beside its render by a process of low priority, while others stand in for them."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from wdpm.cluster.master.local_slaves import SlaveProcess
from wdpm.kernels.cached import cache_folder, remove_half_made
from wdpm.kernels.features import Features
from wdpm.rendering import compile_beside
from wdpm.rendering.compiling import Compiling

GRACE_S = 5.0
"""How long a process that was killed may take to be gone [s]."""


class KernelsBeside:
    """At most one process that compiles, and that ends with this one, however that ends.

    Args:
        when: whether there is any; BESIDE.
    """

    def __init__(self, when: Compiling) -> None:
        self._wanted = when is Compiling.BESIDE
        self._process: SlaveProcess | None = None

    @property
    def running(self) -> bool:
        """Whether there is one."""
        return self._process is not None and self._process.ended() is None

    def compile(self, features: Sequence[Features]) -> None:
        """Have the kernels of these compiled, in this order; does nothing while others are."""
        if not self._wanted or not features or self.running:
            return
        self.stop()
        words = [",".join(each.names()) for each in features]
        self._process = SlaveProcess([sys.executable, "-m", compile_beside.__name__, str(cache_folder()), *words])

    def stop(self) -> None:
        """End it, whatever it is at, and what it has left half made; may be called again."""
        if self._process is not None:
            process, self._process = self._process, None
            process.kill()
            process.stop(GRACE_S)
            remove_half_made(process.number)
