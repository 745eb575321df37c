"""The versions of Warp whose inside is known here. With others wdpm works as well, and starts more slowly.

Two things that Warp has no public way for shorten a start by a third: it is told hashes (remembered.py), and it parses
functions when it needs them (parsed_late.py). Both are done with versions that tests have seen them with.
"""

from __future__ import annotations

import warp as wp

TRIED = ("1.19.",)
"""Beginnings of versions. For another one add it, and run the tests of the two modules above: they compare all names,
and launch kernels of a module that was told its hash."""


def is_tried() -> bool:
    """Whether this Warp's inside is known."""
    return wp.__version__.startswith(TRIED)
