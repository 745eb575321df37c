"""Sums of floats whose result does not depend on the order of the terms.

Floating-point addition rounds, so it is not associative; integer addition is. With m the largest magnitude of all
terms (a maximum: no order) and 2^(e-1) <= m < 2^e, every term is rounded to an integer multiple of the quantum
2^(e - 40), the integers are added, and the sum is converted back. Same set of terms, same bits, however shuffled.

Error: each term is off by half a quantum at most, so n terms by n * 2^(e - 41) <= n * m * 2^-40 (m >= 2^-127; below, by
n * 2^-167); the conversion of the sum to float64 adds nothing for n <= 8192, which keep the integer within 2^53. A
float32 sum may be off by n² * m * 2^-25.

After "prerounding", Demmel & Nguyen 2013, Fast Reproducible Floating-Point Summation.
"""

from __future__ import annotations

import warp as wp

from wdpm.kernels.constants import EXACT_SUM_BITS

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_BITS = wp.constant(wp.int32(EXACT_SUM_BITS))


@wp.func
def magnitude_bits(term: wp.float32) -> wp.int32:
    """Bits of |term|, which sort like the magnitude: the maximum of integers is faster than that of floats.

    Args:
        term: finite.
    """
    return wp.int32(wp.cast(term, wp.uint32) & wp.uint32(0x7FFFFFFF))


@wp.func
def exponent(bits: wp.int32) -> wp.int32:
    """Least e >= -126 with magnitude < 2^e, of the largest `magnitude_bits`. 0 and denormals give -126."""
    return (bits >> 23) - 126


@wp.func
def power_of_two(e: wp.int32) -> wp.float64:
    """2^e, exactly, for -1022 <= e <= 1023."""
    return wp.cast(wp.uint64(e + 1023) << wp.uint64(52), wp.float64)


@wp.func
def quantise(term: wp.float32, e: wp.int32) -> wp.int64:
    """The term in quanta of 2^(e - 40), to nearest, ties to even. The product is exact: a power of two, in float64."""
    return wp.int64(wp.rint(wp.float64(term) * power_of_two(_BITS - e)))


@wp.func
def dequantise(quanta: wp.int64, e: wp.int32) -> wp.float64:
    """The value of a sum of quanta of 2^(e - 40)."""
    return wp.float64(quanta) * power_of_two(e - _BITS)
