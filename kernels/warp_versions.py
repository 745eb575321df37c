"""The versions of Warp whose inside is known here. With others wdpm works as well, and starts more slowly.

Three things that Warp has no public way for shorten a start by half: it is told hashes (module_hashes.py), it parses
functions when it needs them (lazy_parsing.py), and makes its own when somebody looks at them (lazy_builtins.py). A
fourth shortens launches (quick_launch.py). All are done with versions that tests have seen them with.
"""

from __future__ import annotations

import sys

TRIED = ("1.19.",)
"""Beginnings of versions. For another one add it, and run the tests of the four modules above: they compare all
names and all functions, and launch kernels of a module that was told its hash, and by themselves."""


def is_tried() -> bool:
    """Whether this Warp's inside is known; asked also while Warp is being imported."""
    warp = sys.modules["warp"]
    version: str = getattr(warp, "__version__", None) or warp.config.version
    return version.startswith(TRIED)
