"""The process that `wdpm bench effects` has kernels compiled by: alone, and with an empty cache.

A program to be run. Standard input is {"features": [names], "cache": folder} as JSON, without "features" for the
kernels that all scenes share. Standard output is the answer: {"seconds": wall-clock, "modules": compiled}.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import warp as wp

from wdpm.kernels.cached import use_cache_folder
from wdpm.kernels.compile import COMMON
from wdpm.kernels.features import Features
from wdpm.kernels.variants import make_variants
from wdpm.quiet import quiet_warp


def main() -> None:
    """Compile once."""
    order = json.load(sys.stdin)
    quiet_warp()
    folder = Path(order["cache"])
    use_cache_folder(folder)
    modules = _modules(order.get("features"))
    began = time.perf_counter()
    wp.force_load("cpu", modules, max_workers=os.cpu_count())
    seconds = time.perf_counter() - began
    print(json.dumps({"seconds": seconds, "modules": sum(path.is_dir() for path in folder.iterdir())}))


def _modules(names: list[str] | None) -> list[Any]:
    """What is compiled for some features, or for all scenes alike."""
    if names is None:
        return [wp.get_module(module.__name__) for module in COMMON]
    features = Features(**dict.fromkeys(names, True))
    return make_variants(features).modules()


if __name__ == "__main__":
    main()
