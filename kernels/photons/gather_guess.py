"""The radius that a search begins with, told by the one before it: it has a say in time only."""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_FOLLOW = wp.constant(0.2)  # of the distance to the query before
_SLACK = wp.constant(1.04)


@wp.func
def follow(radius: wp.float32, step: wp.float32) -> wp.float32:
    """Guess for a query a step away from one that had this radius; 0, for no guess, if it is too far to tell."""
    guess = _SLACK * radius + _FOLLOW * step
    if step > 2.0 * radius:
        guess = 0.0
    return guess
