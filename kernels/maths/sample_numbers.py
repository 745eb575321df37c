"""The random numbers of a sample: of which stream they are, and which of that.

A sample of a pixel takes the number of the sample in the streams of the pixel. Points of a stream are even over
ranges of numbers, so samples that follow each other differ from each other as much as can be.

First gather rays of irradiance records are numbered in the order of Morton (cluster.work.records.record_wave), by which
strata that lie about each other follow each other. What a ray brings tells how many more its neighbours get, and must
not know what they bring: if it were bright wherever they are dark, bright ones would draw fewer rays, count for more,
and make records too bright (by 4 % where all light is found by shadow rays to a sky, half of which lie below the
surface). So the four of a block of two by two, the last two bits of their numbers, take theirs of four streams: of the
eight around a stratum none has its own, but where an odd number of columns closes its circle. Further rays have streams
of the pixel again, with numbers that no sample has.
"""

from __future__ import annotations

import warp as wp

from wdpm.kernels.limits import FURTHER_RAYS, RAY_SAMPLES
from wdpm.kernels.maths.random import hash_combine

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_FIRST_RAYS = wp.constant(wp.int32(RAY_SAMPLES))
_FURTHER_RAYS = wp.constant(wp.int32(RAY_SAMPLES + FURTHER_RAYS))
_BLOCK = wp.constant(wp.uint32(3))


@wp.func
def item_of_sample(pixel: wp.int32, sample: wp.int32) -> wp.uint32:
    """The item of the streams that a sample's random numbers are of.

    Args:
        pixel: its number in the whole image.
    """
    item = wp.uint32(pixel)
    if sample >= _FIRST_RAYS and sample < _FURTHER_RAYS:
        item = hash_combine(item, wp.uint32(sample) & _BLOCK)
    return item


@wp.func
def number_of_sample(sample: wp.int32) -> wp.uint32:
    """Which number of those streams is a sample's."""
    number = wp.uint32(sample)
    if sample >= _FIRST_RAYS and sample < _FURTHER_RAYS:
        number = number >> wp.uint32(2)
    return number
