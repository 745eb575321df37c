"""When a scene's own kernels are compiled."""

from __future__ import annotations

from enum import Enum


class Compiling(Enum):
    """When a scene's own kernels are compiled, if they have not been, on the CPU.

    BESIDE: kernels with all effects stand in for those that are missing, and the render begins. Another process
        compiles them after it, or beside it if it is long; passes that begin later have what is ready.
    FIRST: before the render.
    NO: kernels with all effects stand in for them.

    Where kernels with all effects are not compiled either, a scene's own are compiled first in any case.
    """

    BESIDE = "beside"
    FIRST = "first"
    NO = "no"
