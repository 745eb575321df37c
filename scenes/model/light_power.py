"""How much flux lights emit: what the first choice among them goes by.

Textured lights are measured at a grid of points. A light is chosen in proportion to what is found here, and weighted by
its chance: an estimate that is off costs noise, not light, as long as none that shines is at zero.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.model.textures import Bitmap, Checkerboard, Texture, Wrap

Array = NDArray[np.float64]

TEXTURE_POINTS = 1 << 17
"""Points at which the triangles of a textured light are measured, all together."""

LEAST_SHARE = 1e-3
"""What a textured triangle counts for at least, as a share of the texture's mean: grids miss small bright spots."""


def triangle_means(texture: Texture, uvs: NDArray[np.float32], colors: NDArray[np.float32]) -> Array:
    """Mean over each triangle of a texture, mean of RGB, float64, shape [T].

    Args:
        uvs: texture coordinates at the corners, shape [T, 3, 2].
        colors: vertex colours at the corners, shape [T, 3, 3], or [0, 3, 3] if there are none.
    """
    side = int(np.clip(math.sqrt(TEXTURE_POINTS / max(len(uvs), 1)), 4, 64))
    weights = _barycentric_grid(side)
    means = np.zeros(len(uvs))
    for weight in weights:
        place = np.einsum("c,tcx->tx", weight, uvs.astype(np.float64))
        color = np.einsum("c,tcx->tx", weight, colors.astype(np.float64)) if len(colors) else np.ones((len(uvs), 3))
        means += texture_values(texture, place, color).mean(axis=1)
    return np.maximum(means / len(weights), LEAST_SHARE * texture_mean(texture, colors))


def texture_mean(texture: Texture, colors: NDArray[np.float32]) -> float:
    """Mean of all that a texture shows, mean of RGB."""
    match texture:
        case Bitmap():
            return float(texture.pixels.mean(dtype=np.float64))
        case Checkerboard():
            return float(np.mean([texture.color0, texture.color1]))
        case _:
            return texture.scale * (float(colors.mean(dtype=np.float64)) if len(colors) else 1.0)


def texture_values(texture: Texture, uv: Array, color: Array) -> Array:
    """A texture at places uv, shape [N, 2], linear RGB, shape [N, 3]; bitmaps by their nearest texel.

    Args:
        color: vertex colours there, shape [N, 3].
    """
    match texture:
        case Bitmap():
            return _texels(texture, uv)
        case Checkerboard():
            x, y = _moved(texture.to_uv, uv).T
            alike = (x - np.floor(x) > 0.5) == (y - np.floor(y) > 0.5)
            return np.where(alike[:, None], np.array(texture.color0), np.array(texture.color1))
        case _:
            return color * texture.scale


def spot_power(intensity: float, cutoff: float, beam: float) -> float:
    """Flux of a spot light without a texture [W].

    The integral of 2 pi sin(a) f(a), where f falls linearly from 1 at `beam` to 0 at `cutoff` [radians].
    """
    if cutoff - beam < 1e-9:
        return intensity * 2.0 * math.pi * (1.0 - math.cos(cutoff))
    return intensity * 2.0 * math.pi * (1.0 - (math.sin(cutoff) - math.sin(beam)) / (cutoff - beam))


def squared_spot_power(intensity: float, cutoff: float, beam: float) -> float:
    """Likewise where f falls as the square of a line in the cosine."""
    full, none = math.cos(beam), math.cos(cutoff)
    return intensity * 2.0 * math.pi * (1.0 - full + (full - none) / 3.0)


def pattern_mean(texture: Bitmap) -> float:
    """Mean of RGB of a texture over the unit square, at least LEAST_SHARE of the texture's own."""
    return _mean_at(texture, _square_grid())


def spot_pattern_mean(texture: Bitmap, cutoff: float) -> float:
    """Mean of RGB of a spot light's texture over the cone, at least LEAST_SHARE of the texture's own."""
    uv = _square_grid()
    inside = np.sum((uv - 0.5) ** 2, axis=1) < 0.25
    # Beyond a right angle the plane that carries the texture is not met, and the formula repeats it.
    return _mean_at(texture, uv if cutoff >= math.pi / 2 else uv[inside])


def _square_grid() -> Array:
    """Places spread evenly over the unit square, shape [N, 2]."""
    place = (np.arange(64) + 0.5) / 64
    return np.stack(np.meshgrid(place, place), axis=2).reshape(-1, 2)


def _mean_at(texture: Bitmap, uv: Array) -> float:
    shown = texture_values(texture, uv, np.ones((1, 3)))
    return max(float(shown.mean()), LEAST_SHARE * texture_mean(texture, np.zeros((0, 3, 3), np.float32)))


def environment_integral(pixels: NDArray[np.float32]) -> float:
    """Radiance of an environment, mean of RGB, integrated over all directions [W/m²]: a pixel a node, bilinear between.

    Integrated by the product of sin(theta)'s exact integral over a row's hat function and the row's mean.
    """
    rows = pixels.shape[0]
    mean = pixels.mean(axis=(1, 2), dtype=np.float64)
    if rows == 1:
        return float(4.0 * math.pi * mean[0])
    step = math.pi / (rows - 1)
    weight = 2.0 * np.sin(step * np.arange(rows)) * (1.0 - math.cos(step)) / step
    weight[[0, -1]] = 1.0 - math.sin(step) / step
    return float(2.0 * math.pi * (weight * mean).sum())


def _barycentric_grid(side: int) -> Array:
    """Weights of the corners at points spread evenly over a triangle, shape [side², 3]: small triangles' centres."""
    weights = []
    for i in range(side):
        for j in range(side - i):
            weights.append((i + 1 / 3, j + 1 / 3))
            if i + j < side - 1:
                weights.append((i + 2 / 3, j + 2 / 3))
    grid = np.array(weights) / side
    return np.column_stack([1.0 - grid.sum(axis=1), grid])


def _moved(to_uv: Array, uv: Array) -> Array:
    return uv @ to_uv[:2, :2].T + to_uv[:2, 2]


def _texels(texture: Bitmap, uv: Array) -> Array:
    """Nearest texels; row 0 is the top of the image, at v = 1."""
    height, width = texture.pixels.shape[:2]
    x, y = _moved(texture.to_uv, uv).T
    column = _wrapped(np.floor(x * width).astype(np.int64), width, texture.wrap)
    row = _wrapped(np.floor((1.0 - y) * height).astype(np.int64), height, texture.wrap)
    return texture.pixels[row, column].astype(np.float64)


def _wrapped(index: NDArray[np.int64], size: int, wrap: Wrap) -> NDArray[np.int64]:
    if wrap is Wrap.CLAMP:
        return np.clip(index, 0, size - 1)
    if wrap is Wrap.REPEAT:
        return index % size
    turned = index % (2 * size)
    return np.minimum(turned, 2 * size - 1 - turned)
