"""`wdpm doctor --prepare`: kernels are compiled before any scene needs them."""

from __future__ import annotations

import math
from collections.abc import Callable

from wdpm.devices import available_cores
from wdpm.kernels.compile import SECONDS_A_MODULE, compile_for_cpu, kernels_for_all_scenes
from wdpm.progress import Progress
from wdpm.quiet import quiet_warp


def prepare_kernels(progress: Progress) -> int:
    """Compile what any scene can be rendered with, on all cores; returns how many modules were not compiled."""
    quiet_warp()

    def told(modules: int) -> Callable[[], None]:
        seconds = math.ceil(modules * SECONDS_A_MODULE / available_cores())
        progress.start("compile", modules)
        progress.note(f"{modules} modules of kernels are compiled, for some {seconds} s, and kept")
        return progress.advance

    try:
        return compile_for_cpu(kernels_for_all_scenes(), told)
    finally:
        progress.finish()
