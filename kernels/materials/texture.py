"""Textures: lookup in one array that holds the texels of all of them, and slopes for bump maps.

Images, checkerboards and colours of vertices; kernels are compiled for the kinds that a scene has.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.features import Features
from wdpm.scenes.model.textures import Bitmap, Checkerboard, Interpolation, Texture, Wrap

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


BITMAP = wp.constant(0)
CHECKERBOARD = wp.constant(1)
VERTEX_COLORS = wp.constant(2)
TINTED_BITMAP = wp.constant(3)
"""An image that is multiplied by the colours of vertices."""

WRAP_REPEAT = wp.constant(0)
WRAP_MIRROR = wp.constant(1)
WRAP_CLAMP = wp.constant(2)
_WRAP_CODE: Final = {Wrap.REPEAT: 0, Wrap.MIRROR: 1, Wrap.CLAMP: 2}


@wp.struct
class Textures:
    """All textures. Texel (row, column) of image i is texel[start[i] + row * width[i] + column].

    The texels of a checkerboard are its two colours; that of vertex colours is a factor.
    """

    kind: wp.array[wp.int32]
    texel: wp.array[wp.vec3]
    start: wp.array[wp.int64]
    width: wp.array[wp.int32]
    height: wp.array[wp.int32]
    wrap: wp.array[wp.int32]
    nearest: wp.array[wp.int32]
    to_uv: wp.array2d[wp.float32]  # [textures, 6]: the first two rows of the 3 x 3 matrix


def upload(textures: Sequence[Texture], device: str) -> Textures:
    """The textures on a device, in their order."""
    pixels = [_pixels(texture) for texture in textures]
    sizes = [image.shape[0] * image.shape[1] for image in pixels]
    wraps = [_WRAP_CODE[t.wrap] if isinstance(t, Bitmap) else 0 for t in textures]
    nearest = [int(isinstance(t, Bitmap) and t.interpolation is Interpolation.NEAREST) for t in textures]
    rows = [_to_uv(texture)[:2].reshape(6) for texture in textures]
    uploaded = Textures()
    uploaded.kind = wp.array([_kind(t) for t in textures] or [0], dtype=wp.int32, device=device)
    uploaded.texel = _texels(pixels, device)
    uploaded.start = wp.array(np.cumsum([0, *sizes])[: max(len(sizes), 1)], dtype=wp.int64, device=device)
    uploaded.width = wp.array([image.shape[1] for image in pixels] or [1], dtype=wp.int32, device=device)
    uploaded.height = wp.array([image.shape[0] for image in pixels] or [1], dtype=wp.int32, device=device)
    uploaded.wrap = wp.array(wraps or [0], dtype=wp.int32, device=device)
    uploaded.nearest = wp.array(nearest or [0], dtype=wp.int32, device=device)
    uploaded.to_uv = wp.array(np.stack(rows) if rows else np.zeros((1, 6), np.float32), dtype=wp.float32, device=device)
    return uploaded


def _texels(pixels: Sequence[NDArray[np.float32]], device: str) -> Any:
    """All texels, one after another. Each is copied once on its way: there may be hundreds of megabytes."""
    if not pixels:
        return wp.zeros(1, dtype=wp.vec3, device=device)
    texels = np.empty((sum(image.size // 3 for image in pixels), 3), np.float32)
    np.concatenate([image.reshape(-1, 3) for image in pixels], out=texels)
    return wp.array(texels, dtype=wp.vec3, device=device, copy=False)


def _kind(texture: Texture) -> int:
    if isinstance(texture, Bitmap):
        return int(TINTED_BITMAP) if texture.tinted else int(BITMAP)
    return int(CHECKERBOARD) if isinstance(texture, Checkerboard) else int(VERTEX_COLORS)


def _pixels(texture: Texture) -> NDArray[np.float32]:
    """Texels, shape [height, width, 3]."""
    if isinstance(texture, Bitmap):
        return texture.pixels
    if isinstance(texture, Checkerboard):
        return np.array([[texture.color0, texture.color1]], np.float32)
    return np.full((1, 1, 3), texture.scale, np.float32)


def _to_uv(texture: Texture) -> NDArray[np.float32]:
    if isinstance(texture, Bitmap | Checkerboard):
        return np.asarray(texture.to_uv, np.float32)
    return np.eye(3, dtype=np.float32)


@wp.func
def luminance(color: wp.vec3) -> wp.float32:
    """Of linear sRGB (ITU-R BT.709)."""
    return 0.212671 * color[0] + 0.715160 * color[1] + 0.072169 * color[2]


@wp.func
def _mapped(textures: wp.ref[Textures], texture: wp.int32, uv: wp.vec2) -> wp.vec2:
    """uv as the texture wants it."""
    u = textures.to_uv[texture, 0] * uv[0] + textures.to_uv[texture, 1] * uv[1] + textures.to_uv[texture, 2]
    v = textures.to_uv[texture, 3] * uv[0] + textures.to_uv[texture, 4] * uv[1] + textures.to_uv[texture, 5]
    # Beyond 2^20 repeats no bit of a float32 is left for the place within one; this also keeps the integers in range.
    return wp.vec2(wp.clamp(u, -1048576.0, 1048576.0), wp.clamp(v, -1048576.0, 1048576.0))


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
def _texel(textures: wp.ref[Textures], texture: wp.int32, column: wp.int32, row: wp.int32) -> wp.vec3:
    width = textures.width[texture]
    height = textures.height[texture]
    wrap = textures.wrap[texture]
    c = _wrapped(column, width, wrap)
    r = _wrapped(row, height, wrap)
    return textures.texel[int(textures.start[texture]) + r * width + c]


@wp.func
def _place(textures: wp.ref[Textures], texture: wp.int32, uv: wp.vec2) -> wp.vec2:
    """Column and row of a place in an image; texel centres lie at half-integers, v grows upwards from the last row."""
    mapped = _mapped(textures, texture, uv)
    u = mapped[0]
    v = mapped[1]
    if textures.wrap[texture] == WRAP_REPEAT:
        u = u - wp.floor(u)
        v = v - wp.floor(v)
    elif textures.wrap[texture] == WRAP_MIRROR:
        u = u - 2.0 * wp.floor(0.5 * u)
        v = v - 2.0 * wp.floor(0.5 * v)
    else:
        u = wp.clamp(u, 0.0, 1.0)
        v = wp.clamp(v, 0.0, 1.0)
    return wp.vec2(u * float(textures.width[texture]), (1.0 - v) * float(textures.height[texture]))


@wp.func
def bitmap_at(textures: wp.ref[Textures], texture: wp.int32, uv: wp.vec2) -> wp.vec3:
    """An image texture at uv."""
    place = _place(textures, texture, uv)
    if textures.nearest[texture] == 1:
        return _texel(textures, texture, int(wp.floor(place[0])), int(wp.floor(place[1])))
    x = place[0] - 0.5
    y = place[1] - 0.5
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


@wp.func
def bitmap_slope(textures: wp.ref[Textures], texture: wp.int32, uv: wp.vec2) -> wp.vec2:
    """Derivative of an image texture's luminance by u and v, that of the bilinear patch between four texels.

    Without interpolation the image is a staircase, whose slope is 0.
    """
    if textures.nearest[texture] == 1:
        return wp.vec2(0.0)
    place = _place(textures, texture, uv)
    x = place[0] - 0.5
    y = place[1] - 0.5
    c = wp.floor(x)
    r = wp.floor(y)
    fx = x - c
    fy = y - r
    column = int(c)
    row = int(r)
    top_left = luminance(_texel(textures, texture, column, row))
    top_right = luminance(_texel(textures, texture, column + 1, row))
    bottom_left = luminance(_texel(textures, texture, column, row + 1))
    bottom_right = luminance(_texel(textures, texture, column + 1, row + 1))
    by_x = (top_right - top_left) * (1.0 - fy) + (bottom_right - bottom_left) * fy
    by_y = (bottom_left - top_left) * (1.0 - fx) + (bottom_right - top_right) * fx
    by_u = by_x * float(textures.width[texture])
    by_v = -by_y * float(textures.height[texture])
    return wp.vec2(
        textures.to_uv[texture, 0] * by_u + textures.to_uv[texture, 3] * by_v,
        textures.to_uv[texture, 1] * by_u + textures.to_uv[texture, 4] * by_v,
    )


@wp.func
def checkerboard_at(textures: wp.ref[Textures], texture: wp.int32, uv: wp.vec2) -> wp.vec3:
    """A checkerboard at uv: color0 where u and v lie in like halves of their repeats, as in Mitsuba."""
    mapped = _mapped(textures, texture, uv)
    first = mapped[0] - wp.floor(mapped[0]) > 0.5
    second = mapped[1] - wp.floor(mapped[1]) > 0.5
    texel = textures.start[texture]
    if first != second:
        texel += wp.int64(1)
    return textures.texel[int(texel)]


@dataclass(frozen=True, eq=False)
class TextureCode:
    """Functions of textures.

    Attributes:
        lookup: `(textures, texture, uv, color) -> vec3`: the texture's value; color is the vertices' colour at the
            point.
        slope: `(textures, texture, uv) -> vec2`: derivative of its luminance by u and v; 0 where it is no image.
    """

    lookup: wp.Function
    slope: wp.Function


@functools.cache
def make_textures(features: Features) -> TextureCode:
    """Lookup for the kinds of textures that features name."""

    @wp.func(inline=False)  # parameters are read in some thirty places
    def lookup(textures: wp.ref[Textures], texture: wp.int32, uv: wp.vec2, color: wp.vec3) -> wp.vec3:
        if wp.static(features.checkerboards):
            if textures.kind[texture] == CHECKERBOARD:
                return checkerboard_at(textures, texture, uv)
        if wp.static(features.vertex_colors):
            if textures.kind[texture] == VERTEX_COLORS:
                return wp.cw_mul(color, textures.texel[int(textures.start[texture])])
            if wp.static(features.bitmaps):
                if textures.kind[texture] == TINTED_BITMAP:
                    return wp.cw_mul(color, bitmap_at(textures, texture, uv))
        if wp.static(features.bitmaps):
            if textures.kind[texture] == BITMAP:
                return bitmap_at(textures, texture, uv)
        return wp.vec3(0.0)

    @wp.func
    def slope(textures: wp.ref[Textures], texture: wp.int32, uv: wp.vec2) -> wp.vec2:
        if wp.static(features.bitmaps):
            if textures.kind[texture] == BITMAP:
                return bitmap_slope(textures, texture, uv)
        return wp.vec2(0.0)

    return TextureCode(lookup, slope)
