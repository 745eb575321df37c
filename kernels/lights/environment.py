"""Light from infinitely far away: an image of all directions, or one radiance for them all.

Pixels are nodes, bilinear between, as in Mitsuba's `envmap`: row r lies at theta = pi r / (height - 1) from the local
+y, the middle of column c at atan2(x, -z) = 2 pi (c + 1/2) / width. Directions are sampled in proportion to the mean of
the channels: first a patch between four nodes, by its mean and the sine of its middle's theta, then a place in it, by
the bilinear interpolation. The density is not quite proportional: it takes the sine to be the same all over a row.
"""

from __future__ import annotations

import math

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.constants import PI
from wdpm.kernels.maths.directions import uniform_sphere
from wdpm.kernels.maths.elementary import atan2_of, sincos_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_INV_SPHERE = wp.constant(wp.float32(1.0 / (4.0 * math.pi)))
_BELOW_ONE = wp.constant(wp.float32(1 - 2.0**-24))
_THIRD = wp.constant(wp.float32(1.0 / 3.0))

COLUMNS_A_CUT = 4
"""Patches of a row for each cut point: some four are left to be searched, in one line of the processor's cache."""


@wp.struct
class Environment:
    """An environment on a device; of 0 columns where there is none, of 1 where it is the same from everywhere.

    Attributes:
        texel: [height * width].
        x, y, z: its local axes in the world.
        rows: share of all patches up to and with a row of them, [height - 1].
        columns: share of a row's patches up to and with a column, [height - 1, width].
        row_cuts, column_cuts: where to look in `rows` and in each row of `columns` (see cut_points).
        sine: of theta in the middle of each row of patches, [height - 1].
        density: what (mean of the channels) times sine times 1 / sin(theta) is multiplied with to give the pdf.
    """

    width: wp.int32
    height: wp.int32
    texel: wp.array[wp.vec3]
    x: wp.vec3
    y: wp.vec3
    z: wp.vec3
    rows: wp.array[wp.float32]
    columns: wp.array2d[wp.float32]
    row_cuts: wp.array2d[wp.int32]
    column_cuts: wp.array2d[wp.int32]
    sine: wp.array[wp.float32]
    density: wp.float32


@wp.struct
class EnvironmentSample:
    """A direction towards the environment, unit, its radiance and pdf_solid_angle (0: nothing sampled)."""

    direction: wp.vec3
    radiance: wp.vec3
    pdf: wp.float32


def upload(pixels: NDArray[np.float32], axes: NDArray[np.float32], device: str) -> Environment:
    """An environment on a device.

    Args:
        pixels: [height, width, 3]; 2x2 at least, 1x1 for a constant one, 0x0 for none.
        axes: rows are the local axes in the world.
    """
    environment = Environment()
    environment.height, environment.width = pixels.shape[:2]
    environment.x, environment.y, environment.z = (wp.vec3(*(float(v) for v in axis)) for axis in axes)
    texels = pixels.reshape(-1, 3) if pixels.size else np.zeros((1, 3), np.float32)
    environment.texel = wp.array(np.ascontiguousarray(texels), dtype=wp.vec3, device=device)
    rows, columns, sine, density = _distribution(pixels)
    environment.rows = wp.array(rows, dtype=wp.float32, device=device)
    environment.columns = wp.array(columns, dtype=wp.float32, device=device)
    environment.row_cuts = wp.array(cut_points(rows[None]), dtype=wp.int32, device=device)
    environment.column_cuts = wp.array(cut_points(columns), dtype=wp.int32, device=device)
    environment.sine = wp.array(sine, dtype=wp.float32, device=device)
    environment.density = density
    return environment


def patch_weights(pixels: NDArray[np.float32]) -> NDArray[np.float64]:
    """Mean radiance times sine of each patch between four nodes, shape [height - 1, width]."""
    node = (pixels[..., 0].astype(np.float64) + pixels[..., 1] + pixels[..., 2]) / 3.0
    pair = node + np.roll(node, -1, axis=1)
    weight: NDArray[np.float64] = (pair[:-1] + pair[1:]) / 4.0 * _sines(len(pixels) - 1)[:, None]
    return weight


def _distribution(
    pixels: NDArray[np.float32],
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], float]:
    """Environment's rows, columns, sine and density."""
    height, width = pixels.shape[:2]
    if min(height, width) < 2:
        return np.ones(1, np.float32), np.ones((1, 1), np.float32), np.ones(1, np.float32), 0.0
    sine = _sines(height - 1)
    weight = patch_weights(pixels)
    by_row = np.cumsum(weight, axis=1)[:, -1]  # one after the other: the order of np.sum is the machine's
    columns = cumulative_shares(weight)
    rows = cumulative_shares(by_row[None])[0]
    total = np.cumsum(by_row)[-1]
    density = width * (height - 1) / (2.0 * math.pi**2 * total) if total > 0 else 0.0
    return rows, columns, sine.astype(np.float32), float(density)


def _sines(count: int) -> NDArray[np.float64]:
    """sin(pi (r + 1/2) / count) for all r, the same on every machine: a Taylor series up to a right angle."""
    place = (np.arange(count) + 0.5) / count
    angle = np.minimum(place, 1.0 - place) * math.pi
    square, term, total = angle * angle, angle.copy(), angle.copy()
    for k in range(1, 12):
        term = -term * square / ((2 * k) * (2 * k + 1))
        total = total + term
    return np.asarray(total)


def cumulative_shares(weight: NDArray[np.float64]) -> NDArray[np.float32]:
    """Shares up to and with each column, by row; exactly 1 from the last that has any, and all 1 where none has."""
    total = np.cumsum(weight, axis=1)
    last = total[:, -1:]
    share = np.divide(total, last, out=np.ones_like(total), where=last > 0).astype(np.float32)
    share[total == last] = 1.0
    return share


def cut_points(shares: NDArray[np.float32]) -> NDArray[np.int32]:
    """Where the search for a share begins and ends (Chen & Asau 1974, "On Generating Random Variates from an Empirical
    Distribution").

    Of m + 1 cut points entry g is the first column whose share exceeds g / m, or the last one: what exceeds a share
    from g / m to (g + 1) / m lies between entries g and g + 1. As m is a power of two, shares are told apart exactly.

    Args:
        shares: up to and with each column, by row, never falling, at most 1, shape [rows, columns].

    Returns:
        shape [rows, m + 1].
    """
    rows, columns = shares.shape
    m = 1 << max(0, (columns // COLUMNS_A_CUT).bit_length() - 1)
    first = np.ceil(shares * np.float32(m)).astype(np.int64)  # the first cut that is not below each share
    key = (np.arange(rows)[:, None] * (m + 1) + first).reshape(-1)
    not_above = np.bincount(key, minlength=rows * (m + 1)).reshape(rows, m + 1).cumsum(axis=1)
    return np.minimum(not_above, columns - 1).astype(np.int32)


@wp.func
def _texel(e: wp.ref[Environment], row: wp.int32, column: wp.int32) -> wp.vec3:
    return e.texel[row * e.width + column % e.width]


@wp.func
def _patch(e: wp.ref[Environment], row: wp.int32, column: wp.int32, fx: wp.float32, fy: wp.float32) -> wp.vec3:
    """Radiance at a place in the patch between four nodes."""
    top = _texel(e, row, column) * (1.0 - fx) + _texel(e, row, column + 1) * fx
    bottom = _texel(e, row + 1, column) * (1.0 - fx) + _texel(e, row + 1, column + 1) * fx
    return top * (1.0 - fy) + bottom * fy


@wp.func
def _mean(rgb: wp.vec3) -> wp.float32:
    return (rgb[0] + rgb[1] + rgb[2]) * _THIRD


@wp.func
def _place(e: wp.ref[Environment], direction: wp.vec3) -> wp.vec3:
    """Column and row of a direction, and the sine of its theta."""
    x = wp.dot(direction, e.x)
    y = wp.dot(direction, e.y)
    z = wp.dot(direction, e.z)
    column = atan2_of(x, -z) * (0.5 / PI) * wp.float32(e.width) - 0.5
    if column < 0.0:
        column += wp.float32(e.width)
    sine = wp.sqrt(x * x + z * z)
    row = atan2_of(sine, y) * (1.0 / PI) * wp.float32(e.height - 1)  # an arc cosine would be blunt at the poles
    return wp.vec3(column, row, sine)


@wp.struct
class PatchSeen:
    """What is seen of an environment that is no constant in a direction.

    Attributes:
        row, column: of the patch.
        sine: of the direction's theta.
    """

    row: wp.int32
    column: wp.int32
    sine: wp.float32
    radiance: wp.vec3


@wp.func
def _seen(e: wp.ref[Environment], direction: wp.vec3) -> PatchSeen:
    seen = PatchSeen()
    place = _place(e, direction)
    seen.column = wp.min(wp.int32(place[0]), e.width - 1)
    seen.row = wp.min(wp.int32(place[1]), e.height - 2)
    seen.sine = place[2]
    seen.radiance = _patch(
        e, seen.row, seen.column, place[0] - wp.float32(seen.column), place[1] - wp.float32(seen.row)
    )
    return seen


@wp.func
def environment_value(e: wp.ref[Environment], direction: wp.vec3) -> wp.vec3:
    """Radiance that arrives from a direction (unit, pointing to where it comes from)."""
    if e.width == 1:
        return e.texel[0]
    return _seen(e, direction).radiance


@wp.struct
class PatchPdf:
    """The patch of a direction, its radiance, and pdf_solid_angle with which sample_environment makes the direction."""

    row: wp.int32
    column: wp.int32
    radiance: wp.vec3
    pdf: wp.float32


@wp.func
def patch_pdf(e: wp.ref[Environment], direction: wp.vec3) -> PatchPdf:
    """The patch of a direction of an environment that is no constant."""
    seen = _seen(e, direction)
    found = PatchPdf()
    found.column = seen.column
    found.row = seen.row
    found.radiance = seen.radiance
    if seen.sine > 0.0:
        found.pdf = _mean(seen.radiance) * (e.sine[seen.row] * e.density / seen.sine)
    return found


@wp.func
def environment_seen(e: wp.ref[Environment], direction: wp.vec3) -> EnvironmentSample:
    """A direction as sample_environment would have made it."""
    s = EnvironmentSample()
    s.direction = direction
    if e.width == 1:
        s.radiance = e.texel[0]
        s.pdf = _INV_SPHERE
    else:
        patch = patch_pdf(e, direction)
        s.radiance = patch.radiance
        s.pdf = patch.pdf
    return s


@wp.func
def _cut_of(u: wp.float32, cuts: wp.int32) -> wp.int32:
    """The cut point at or below a share."""
    return wp.clamp(wp.int32(u * wp.float32(cuts)), 0, cuts - 1)


@wp.func
def _search_rows(e: wp.ref[Environment], u: wp.float32) -> wp.int32:
    """The first row of patches whose cumulative share exceeds u."""
    cut = _cut_of(u, e.row_cuts.shape[1] - 1)
    low = e.row_cuts[0, cut]
    high = e.row_cuts[0, cut + 1]
    while low < high:
        middle = (low + high) >> 1
        if e.rows[middle] <= u:
            low = middle + 1
        else:
            high = middle
    return low


@wp.func
def _search_columns(e: wp.ref[Environment], row: wp.int32, u: wp.float32) -> wp.int32:
    cut = _cut_of(u, e.column_cuts.shape[1] - 1)
    low = e.column_cuts[row, cut]
    high = e.column_cuts[row, cut + 1]
    while low < high:
        middle = (low + high) >> 1
        if e.columns[row, middle] <= u:
            low = middle + 1
        else:
            high = middle
    return low


@wp.func
def share_left(u: wp.float32, before: wp.float32, after: wp.float32) -> wp.float32:
    """Where u lies between two shares, in [0, 1)."""
    if after <= before:
        return 0.5
    return wp.clamp((u - before) / (after - before), 0.0, _BELOW_ONE)


@wp.func
def _linear(u: wp.float32, a: wp.float32, b: wp.float32) -> wp.float32:
    """A number in [0, 1] with density proportional to a (1 - x) + b x."""
    if a + b <= 0.0:
        return u
    scale = 1.0 / wp.max(a, b)  # or squares would leave float32's range
    low = a * scale
    high = b * scale
    root = wp.sqrt(low * low * (1.0 - u) + high * high * u)
    if low + root <= 0.0:
        return 0.0
    return wp.min(u * (low + high) / (low + root), 1.0)


@wp.func
def sample_environment(e: wp.ref[Environment], u: wp.vec2) -> EnvironmentSample:
    """A direction in proportion to radiance (mean of the channels); a uniform one where it is constant."""
    s = EnvironmentSample()
    if e.width == 1:
        s.direction = uniform_sphere(u)
        s.radiance = e.texel[0]
        s.pdf = _INV_SPHERE
        return s
    row = _search_rows(e, u[1])
    before = wp.float32(0.0)
    if row > 0:
        before = e.rows[row - 1]
    v = share_left(u[1], before, e.rows[row])
    column = _search_columns(e, row, u[0])
    before = wp.float32(0.0)
    if column > 0:
        before = e.columns[row, column - 1]
    h = share_left(u[0], before, e.columns[row, column])
    return in_patch(e, row, column, h, v)


@wp.func
def in_patch(
    e: wp.ref[Environment], row: wp.int32, column: wp.int32, h: wp.float32, v: wp.float32
) -> EnvironmentSample:
    """A direction in a patch in proportion to radiance; its pdf is that of sample_environment.

    Args:
        h, v: a point of the unit square.
    """
    s = EnvironmentSample()
    m00 = _mean(_texel(e, row, column))
    m10 = _mean(_texel(e, row, column + 1))
    m01 = _mean(_texel(e, row + 1, column))
    m11 = _mean(_texel(e, row + 1, column + 1))
    fy = _linear(v, m00 + m10, m01 + m11)
    fx = _linear(h, m00 * (1.0 - fy) + m01 * fy, m10 * (1.0 - fy) + m11 * fy)
    theta = sincos_of(PI * (wp.float32(row) + fy) / wp.float32(e.height - 1))
    phi = sincos_of(2.0 * PI * (wp.float32(column) + fx + 0.5) / wp.float32(e.width))
    if theta[0] > 0.0:
        s.direction = e.x * (theta[0] * phi[0]) + e.y * theta[1] - e.z * (theta[0] * phi[1])
        s.radiance = _patch(e, row, column, fx, fy)
        s.pdf = _mean(s.radiance) * (e.sine[row] * e.density / theta[0])
    return s
