"""The process that compiles a scene's kernels beside its render (kernels_beside.py).

A program: `python -m wdpm.rendering.compile_beside FOLDER EFFECTS...` compiles the kernels of each set of effects,
names with commas between them, into Warp's cache in FOLDER. It ends when standard input closes, which its starter
holds open.
"""

from __future__ import annotations

import os
import sys
import threading
from pathlib import Path

from wdpm.kernels.features import Features

NICENESS = 5
"""Added to that of the render: where cores are busy, it has about a quarter of one beside a process that renders."""


def main(arguments: list[str]) -> None:
    """Compile, one module at a time."""
    threading.Thread(target=_end_with_starter, daemon=True).start()
    if hasattr(os, "nice"):  # not on Windows
        os.nice(NICENESS)
    from wdpm.kernels.cached import use_cache_folder
    from wdpm.kernels.compile import compile_for_cpu
    from wdpm.kernels.variants import make_variants
    from wdpm.quiet import quiet_warp

    folder, *wanted = arguments
    quiet_warp()
    use_cache_folder(Path(folder))
    for names in wanted:
        features = Features(**dict.fromkeys(filter(None, names.split(",")), True))
        compile_for_cpu(make_variants(features).modules(), threads=1)


def _end_with_starter() -> None:
    sys.stdin.buffer.read()
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1:])
