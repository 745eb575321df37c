"""Random numbers as a function of what they are for: nothing is stored, nothing travels with a ray.

Every number is a function of (seed, purpose, item, dimension) alone (exactness contract, item 1). Two-dimensional
points are Sobol's first two dimensions, shuffled and Owen-scrambled by hashing (Burley 2020, "Practical Hash-based
Owen Scrambling", JCGT 9(4)), so consecutive items of one stream are stratified and streams are independent.
"""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

TO_UNIT = wp.constant(wp.float32(2.0**-24))
"""24 random bits become a float in [0, 1): every multiple of 2^-24 below 1 is a float32."""

TO_UNIT_DOUBLE = wp.constant(wp.float64(2.0**-32))
_STEPS = wp.constant(wp.float64(2.0**24))

# Purposes: the first word of every stream, so that no two uses share their numbers.
PURPOSE_PIXEL = wp.constant(wp.uint32(0x50495845))
PURPOSE_LIGHT = wp.constant(wp.uint32(0x4C494748))
PURPOSE_EMISSION = wp.constant(wp.uint32(0x454D4954))
PURPOSE_SCATTER = wp.constant(wp.uint32(0x53434154))
PURPOSE_CAUSTIC = wp.constant(wp.uint32(0x43415553))
PURPOSE_BOUNCE = wp.constant(wp.uint32(0x424F554E))
PURPOSE_MEDIUM = wp.constant(wp.uint32(0x4D454449))
PURPOSE_RECORD = wp.constant(wp.uint32(0x5245434F))
PURPOSE_GUIDE = wp.constant(wp.uint32(0x47554944))
PURPOSE_PICK = wp.constant(wp.uint32(0x5049434B))

# Words of the hashes; constants, since a literal above 2^31 does not fit the int that Warp makes of it.
_LOWBIAS_1 = wp.constant(wp.uint32(0x7FEB352D))
_LOWBIAS_2 = wp.constant(wp.uint32(0x846CA68B))
_GOLDEN = wp.constant(wp.uint32(0x9E3779B9))
_MASK_1 = wp.constant(wp.uint32(0x55555555))
_MASK_2 = wp.constant(wp.uint32(0x33333333))
_MASK_4 = wp.constant(wp.uint32(0x0F0F0F0F))
_MASK_8 = wp.constant(wp.uint32(0x00FF00FF))
_MASK_16 = wp.constant(wp.uint32(0x0000FFFF))
_OWEN_1 = wp.constant(wp.uint32(0x6C50B47C))
_OWEN_2 = wp.constant(wp.uint32(0xB82F1E52))
_OWEN_3 = wp.constant(wp.uint32(0xC7AFE638))
_OWEN_4 = wp.constant(wp.uint32(0x8D22F6E6))


@wp.func
def hash_word(x: wp.uint32) -> wp.uint32:
    """A bijection of 32 bits with little bias (Wellons 2018, "lowbias32")."""
    x = x ^ (x >> wp.uint32(16))
    x = x * _LOWBIAS_1
    x = x ^ (x >> wp.uint32(15))
    x = x * _LOWBIAS_2
    return x ^ (x >> wp.uint32(16))


@wp.func
def hash_combine(h: wp.uint32, x: wp.uint32) -> wp.uint32:
    """Fold another word into a hash."""
    return hash_word((h ^ x) + _GOLDEN)


@wp.func
def reverse_bits(x: wp.uint32) -> wp.uint32:
    """Bit 0 becomes bit 31 and so on."""
    x = ((x & _MASK_1) << wp.uint32(1)) | ((x >> wp.uint32(1)) & _MASK_1)
    x = ((x & _MASK_2) << wp.uint32(2)) | ((x >> wp.uint32(2)) & _MASK_2)
    x = ((x & _MASK_4) << wp.uint32(4)) | ((x >> wp.uint32(4)) & _MASK_4)
    x = ((x & _MASK_8) << wp.uint32(8)) | ((x >> wp.uint32(8)) & _MASK_8)
    return (x << wp.uint32(16)) | (x >> wp.uint32(16))


@wp.func
def scramble_reversed(x: wp.uint32, seed: wp.uint32) -> wp.uint32:
    """Owen scrambling of a word whose bits are reversed (Laine & Karras 2011, constants by Vegdahl 2021)."""
    x = x + seed
    x = x ^ (x * _OWEN_1)
    x = x ^ (x * _OWEN_2)
    x = x ^ (x * _OWEN_3)
    return x ^ (x * _OWEN_4)


@wp.func
def sobol_second_reversed(index: wp.uint32) -> wp.uint32:
    """Sobol's second dimension, bits reversed.

    Its generator matrix is Pascal's triangle modulo 2, and binomial(j, i) is odd iff the bits of i are a subset of
    those of j (Lucas), so the product is a subset sum and takes five steps instead of 32.
    """
    x = index
    x = x ^ ((x >> wp.uint32(1)) & _MASK_1)
    x = x ^ ((x >> wp.uint32(2)) & _MASK_2)
    x = x ^ ((x >> wp.uint32(4)) & _MASK_4)
    x = x ^ ((x >> wp.uint32(8)) & _MASK_8)
    return x ^ ((x >> wp.uint32(16)) & _MASK_16)


@wp.func
def shuffled(index: wp.uint32, stream: wp.uint32) -> wp.uint32:
    """The index permuted so that every aligned block of 2^m indices stays one (Burley 2020, section 4)."""
    return reverse_bits(scramble_reversed(reverse_bits(index), stream))


@wp.func
def sample_2d(index: wp.uint32, stream: wp.uint32) -> wp.vec2:
    """Item `index` of a stream of stratified points in [0, 1)^2."""
    i = shuffled(index, stream)
    x = reverse_bits(scramble_reversed(i, hash_combine(stream, wp.uint32(1))))
    y = reverse_bits(scramble_reversed(sobol_second_reversed(i), hash_combine(stream, wp.uint32(2))))
    return wp.vec2(float(x >> wp.uint32(8)) * TO_UNIT, float(y >> wp.uint32(8)) * TO_UNIT)


@wp.func
def sample_2d_fine(index: wp.uint32, stream: wp.uint32) -> wp.vec2d:
    """As sample_2d, with 32 bits a number: enough to pick one of many, and still be a point within what was picked."""
    i = shuffled(index, stream)
    x = reverse_bits(scramble_reversed(i, hash_combine(stream, wp.uint32(1))))
    y = reverse_bits(scramble_reversed(sobol_second_reversed(i), hash_combine(stream, wp.uint32(2))))
    return wp.vec2d(wp.float64(x) * TO_UNIT_DOUBLE, wp.float64(y) * TO_UNIT_DOUBLE)


@wp.func
def rounded_down(u: wp.float64) -> wp.float32:
    """A number in [0, 1) as a multiple of 2^-24: never 1."""
    return float(wp.uint32(u * _STEPS)) * TO_UNIT


@wp.func
def sample_1d(index: wp.uint32, stream: wp.uint32) -> wp.float64:
    """Item `index` of a stream of stratified numbers in [0, 1), with 32 bits: enough to pick one of many lights."""
    i = shuffled(index, stream)
    x = reverse_bits(scramble_reversed(i, hash_combine(stream, wp.uint32(1))))
    return wp.float64(x) * TO_UNIT_DOUBLE


@wp.func
def stream_of(seed: wp.uint32, purpose: wp.uint32, item: wp.uint32, dimension: wp.int32) -> wp.uint32:
    """The name of a stream."""
    return hash_combine(hash_combine(hash_combine(purpose, seed), item), wp.uint32(dimension))
