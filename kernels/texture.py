"""Image textures: lookup in one array that holds the texels of all of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp

from wdpm.scenes.model import Bitmap, Interpolation, Wrap

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

WRAP_REPEAT = wp.constant(0)
WRAP_MIRROR = wp.constant(1)
WRAP_CLAMP = wp.constant(2)
_WRAP_CODE = {Wrap.REPEAT: 0, Wrap.MIRROR: 1, Wrap.CLAMP: 2}


@wp.struct
class Textures:
    """All textures. Texel (row, column) of texture i is texel[start[i] + row * width[i] + column]."""

    texel: wp.array[wp.vec3]
    start: wp.array[wp.int64]
    width: wp.array[wp.int32]
    height: wp.array[wp.int32]
    wrap: wp.array[wp.int32]
    nearest: wp.array[wp.int32]
    to_uv: wp.array2d[wp.float32]  # [textures, 6]: the first two rows of the 3 x 3 matrix


def upload(bitmaps: Sequence[Bitmap], device: str) -> Textures:
    """The textures on a device."""
    sizes = [bitmap.pixels.shape[0] * bitmap.pixels.shape[1] for bitmap in bitmaps]
    texels = [bitmap.pixels.reshape(-1, 3) for bitmap in bitmaps]
    textures = Textures()
    textures.texel = wp.array(
        np.concatenate(texels).astype(np.float32) if texels else np.zeros((1, 3), np.float32),
        dtype=wp.vec3,
        device=device,
    )
    textures.start = wp.array(np.cumsum([0, *sizes])[: max(len(sizes), 1)], dtype=wp.int64, device=device)
    textures.width = wp.array([b.pixels.shape[1] for b in bitmaps] or [1], dtype=wp.int32, device=device)
    textures.height = wp.array([b.pixels.shape[0] for b in bitmaps] or [1], dtype=wp.int32, device=device)
    textures.wrap = wp.array([_WRAP_CODE[b.wrap] for b in bitmaps] or [0], dtype=wp.int32, device=device)
    textures.nearest = wp.array(
        [int(b.interpolation is Interpolation.NEAREST) for b in bitmaps] or [0], dtype=wp.int32, device=device
    )
    rows = [np.asarray(b.to_uv, np.float32)[:2].reshape(6) for b in bitmaps]
    textures.to_uv = wp.array(np.stack(rows) if rows else np.zeros((1, 6), np.float32), dtype=wp.float32, device=device)
    return textures


@wp.func
def _wrapped(i: wp.int32, n: wp.int32, wrap: wp.int32) -> wp.int32:
    """Column or row `i` brought into 0 .. n - 1."""
    if wrap == WRAP_CLAMP:
        return wp.clamp(i, 0, n - 1)
    period = n
    if wrap == WRAP_MIRROR:
        period = 2 * n
    m = i % period
    if m < 0:
        m += period
    if m >= n:  # only a mirrored period is longer than the image
        m = 2 * n - 1 - m
    return m


@wp.func
def _texel(textures: Textures, texture: wp.int32, column: wp.int32, row: wp.int32) -> wp.vec3:
    width = textures.width[texture]
    height = textures.height[texture]
    wrap = textures.wrap[texture]
    c = _wrapped(column, width, wrap)
    r = _wrapped(row, height, wrap)
    return textures.texel[int(textures.start[texture]) + r * width + c]


@wp.func
def lookup(textures: Textures, texture: wp.int32, uv: wp.vec2) -> wp.vec3:
    """The texture at uv; texel centres lie at half-integers, v grows upwards from the last row."""
    u = textures.to_uv[texture, 0] * uv[0] + textures.to_uv[texture, 1] * uv[1] + textures.to_uv[texture, 2]
    v = textures.to_uv[texture, 3] * uv[0] + textures.to_uv[texture, 4] * uv[1] + textures.to_uv[texture, 5]
    # Beyond 2^20 repeats no bit of a float32 is left for the place within one; this also keeps the integers in range.
    u = wp.clamp(u, -1048576.0, 1048576.0)
    v = wp.clamp(v, -1048576.0, 1048576.0)
    if textures.wrap[texture] == WRAP_REPEAT:
        u = u - wp.floor(u)
        v = v - wp.floor(v)
    elif textures.wrap[texture] == WRAP_MIRROR:
        u = u - 2.0 * wp.floor(0.5 * u)
        v = v - 2.0 * wp.floor(0.5 * v)
    else:
        u = wp.clamp(u, 0.0, 1.0)
        v = wp.clamp(v, 0.0, 1.0)
    x = u * float(textures.width[texture])
    y = (1.0 - v) * float(textures.height[texture])
    if textures.nearest[texture] == 1:
        return _texel(textures, texture, int(wp.floor(x)), int(wp.floor(y)))
    x = x - 0.5
    y = y - 0.5
    c = wp.floor(x)
    r = wp.floor(y)
    fx = x - c
    fy = y - r
    column = int(c)
    row = int(r)
    top = _texel(textures, texture, column, row) * (1.0 - fx) + _texel(textures, texture, column + 1, row) * fx
    bottom = (
        _texel(textures, texture, column, row + 1) * (1.0 - fx) + _texel(textures, texture, column + 1, row + 1) * fx
    )
    return top * (1.0 - fy) + bottom * fy
