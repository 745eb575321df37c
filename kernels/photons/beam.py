"""The beam radiance estimate: light that a medium scatters towards the camera all along a ray, from volume photons.

Jarosz, Zwicker & Jensen 2008, "The Beam Radiance Estimate for Volumetric Photon Mapping": instead of marching along the
ray and gathering at points, every photon near the ray counts once, where the ray passes it:

    radiance = sum over photons of flux * phase function * transmittance to t * K(distance to the ray)

with t the photon's projection onto the ray and K a kernel over the disc across it, here Silverman's biweight,
3 / (pi r²) (1 - d² / r²)², whose integral over the disc is 1. The radius r is the same for all photons: what a beam
sees of a photon then depends on the two alone.

Where the disc reaches out of the medium there are no photons, and the sum would be too dark: by 8 to 40 % in small or
dense things. So K is divided by its integral over the part of the disc that is inside (`share_inside`), by what the
beam knows of that: the planes of the surfaces that it begins and ends at.

The sum does not depend on tree, order or partition:

* Whether a photon is within reach, and where, is computed in float64 by one function from beam and photon alone. What
  comes before it, boxes and a float32 test of eight photons at a time, only never rejects what that accepts.
* Of the cells that have a copy of a photon, the one counts it that owns its projection, a point of the beam. The beam
  passes that cell, and the photon is within r of it: a band of r plus `pad` is complete.
* Each contribution is rounded to an integer multiple of one unit, the same for the whole image; integers are added.

Volume photons lie in a `PhotonMap` like others, built by `photon_map.build`. They have no normal: its x is the number
of the medium, as a float. Unused places of leaves look like photons of medium 0 at (0, 0, 0), without flux: they add 0.
"""

from __future__ import annotations

import functools
import math

import warp as wp

from wdpm.kernels.columns import FromFields, columns_of
from wdpm.kernels.constants import EXACT_SUM_BITS, MAX_GATHER_RADIUS, MIN_GATHER_RADIUS
from wdpm.kernels.features import Features
from wdpm.kernels.fields import chosen
from wdpm.kernels.made_for import made_for
from wdpm.kernels.materials.medium import Media, phase_value, transmittance
from wdpm.kernels.photons.beam_lengths import MARKS, length_at, mark_beam
from wdpm.kernels.photons.gather import dot8
from wdpm.kernels.photons.photon_map import LEAF_ROWS, NODE_ROWS, PhotonMap, first_child, vec8
from wdpm.kernels.ray_fields import BEAM
from wdpm.kernels.rays.cells import Cells, cell_of, inverse_direction
from wdpm.scenes.errors import SettingsError

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_STACK = wp.constant(128)  # as in gather.py
_BIWEIGHT = wp.constant(wp.float64(3 / math.pi))
_ONE = wp.constant(wp.float64(1.0))
_ZERO = wp.constant(wp.float64(0.0))
_HALF = wp.constant(wp.float64(0.5))
_C1, _C3, _C5, _C7, _C9 = (
    wp.constant(wp.float64(c)) for c in (1.01854961, -0.84797784, 0.37736010, -0.03586028, -0.01204588)
)
_UPRIGHT = wp.constant(wp.float64(1e-6))  # below it a plane is across the beam, and cuts no disc
_LARGEST_QUANTA = wp.constant(wp.float64(2.0**EXACT_SUM_BITS))

LEAST_INSIDE = 0.25
"""Of a disc's kernel, that is taken to be inside the medium at least: where two surfaces meet at a beam."""

_LEAST_INSIDE = wp.constant(wp.float64(LEAST_INSIDE))

_BOX_PAD = wp.constant(2.0**-20)
"""Growth of boxes beyond the radius, as a share of S = |origin| + |photon| + radius, in largest coordinates.

What is rounded, against a face in exact numbers: the grown radius and its sum with the origin, together at most 2 S;
the face minus that, at most 3 S; an inverse direction and the product with it, 3 S each. With what the padding itself
is rounded by these are 12 S times 2^-24; the growth is 16.
"""

_LEAF_PAD = wp.constant(2.0**-18)
"""The same for the float32 distance of a photon to the line of the beam.

With coordinates of the photon from the origin up to S: their rounding, that of the sum along the line (three), of its
product with the direction and of the difference come to 12.2 S times 2^-24 in length; a direction whose squared length
is 1 up to 2^-21.2 moves the nearest point by as much again. 2^-19.4 S together; the sum of squares adds 2^-22 S.
"""


@columns_of(chosen(BEAM, "origin", "direction", "length", "medium", "start", "end", "red", "green", "blue"))
class Beams(FromFields):
    """Stretches of camera rays, each in one medium, and the light scattered into them so far.

    No coordinate of an origin may be above MAX_PHOTON_COORDINATE; a length is at least 0 and may be infinite. The sums
    are radiance that leaves the origin against the direction, times the number of photon paths, in units of `sum_unit`.

    Attributes:
        clamped: contributions that were larger than the unit allows for, and were cut: 0, or the unit was wrong.
    """

    clamped: wp.array[wp.int32]


def sum_unit(largest_flux: float, radius: float, g: float) -> float:
    """The unit that contributions are rounded to: 2^-40 of a power of two above the largest there can be.

    Args:
        largest_flux: of all volume photons of the image, in any channel, as a float32 holds it; above 0.
        radius: of the beams [scene units], MIN_GATHER_RADIUS to MAX_GATHER_RADIUS.
        g: mean cosine of the medium with the most peaked phase function.

    Raises:
        SettingsError: there is no such unit.
    """
    if not (0 < largest_flux < math.inf and MIN_GATHER_RADIUS <= radius <= MAX_GATHER_RADIUS and abs(g) < 1):
        raise SettingsError(f"no unit for beams of radius {radius:g}, photons of flux {largest_flux:g} and g = {g:g}")
    peak = (1 + abs(g)) / (4 * math.pi * (1 - abs(g)) ** 2)
    largest = largest_flux * peak * 3 / (math.pi * radius**2) / LEAST_INSIDE
    # Twice as much, as the kernel's floats may be a rounding above.
    return math.ldexp(1.0, math.frexp(largest)[1] + 1 - EXACT_SUM_BITS)


@wp.func
def closest_point(origin: wp.vec3, direction: wp.vec3, point: wp.vec3) -> wp.vec2d:
    """(t, squared distance) of the point of a line that is nearest to `point`: the one place where it is computed.

    Args:
        direction: of any length but 0; t is in units of it.
    """
    d = wp.vec3d(wp.float64(direction[0]), wp.float64(direction[1]), wp.float64(direction[2]))
    to = wp.vec3d(
        wp.float64(point[0]) - wp.float64(origin[0]),
        wp.float64(point[1]) - wp.float64(origin[1]),
        wp.float64(point[2]) - wp.float64(origin[2]),
    )
    t = wp.dot(to, d) / wp.dot(d, d)
    across = to - t * d
    return wp.vec2d(t, wp.dot(across, across))


@wp.func
def point_at(origin: wp.vec3, direction: wp.vec3, t: wp.float64) -> wp.vec3:
    """A point of a line, rounded once."""
    return wp.vec3(
        wp.float32(wp.float64(origin[0]) + t * wp.float64(direction[0])),
        wp.float32(wp.float64(origin[1]) + t * wp.float64(direction[1])),
        wp.float32(wp.float64(origin[2]) + t * wp.float64(direction[2])),
    )


@wp.func
def biweight(distance2: wp.float64, radius2: wp.float64) -> wp.float64:
    """Silverman's kernel over a disc, 0 <= distance2 < radius2 (Density Estimation, 1986, equation 4.5)."""
    inside = _ONE - distance2 / radius2
    return _BIWEIGHT / radius2 * inside * inside


@wp.func
def _beyond_middle(x: wp.float64) -> wp.float64:
    """The biweight kernel's integral over what of its disc lies between its middle and a line at x radii, 0 <= x.

    A polynomial that is off by 3e-5 at most.
    """
    y = wp.min(x, _ONE)
    z = y * y
    sum = _C7 + z * _C9
    sum = _C3 + z * (_C5 + z * sum)
    return wp.min(y * (_C1 + z * sum), _HALF)


@wp.func
def share_inside(
    direction: wp.vec3, start: wp.vec3, end: wp.vec3, length: wp.float64, t: wp.float64, radius: wp.float64
) -> wp.float64:
    """How much of the kernel across a beam, at t of its length, is on the inner sides of the surfaces at its ends.

    A disc is cut by the plane of each. Where both lie on the same side of the beam they are taken for one curved
    surface, as of a sphere: its height above the beam is the cubic that begins and ends with the slopes of the planes.

    Args:
        direction: unit.
        start, end: normals of the surfaces on the beam's side; zero for none.
    """
    along = wp.vec3d(wp.float64(direction[0]), wp.float64(direction[1]), wp.float64(direction[2]))
    first = wp.vec3d(wp.float64(start[0]), wp.float64(start[1]), wp.float64(start[2]))
    last = wp.vec3d(wp.float64(end[0]), wp.float64(end[1]), wp.float64(end[2]))
    rises, falls = wp.dot(first, along), -wp.dot(last, along)
    across_first, across_last = first - rises * along, last + falls * along
    lean_first, lean_last = wp.length(across_first), wp.length(across_last)
    cut_first = rises > _ZERO and lean_first > _UPRIGHT
    cut_last = falls > _ZERO and lean_last > _UPRIGHT
    inside = _ONE
    if cut_first:
        inside -= _HALF - _beyond_middle(t * rises / (lean_first * radius))
    if cut_last:
        inside -= _HALF - _beyond_middle((length - t) * falls / (lean_last * radius))
    if cut_first and cut_last:
        alike = wp.dot(across_first, across_last) / (lean_first * lean_last)
        if alike > _ZERO:
            s = t / length
            height = s * (_ONE - s) * length * ((_ONE - s) * rises / lean_first + s * falls / lean_last)
            curved = _HALF + _beyond_middle(height / radius)
            inside += alike * (curved - inside)
    return wp.max(inside, _LEAST_INSIDE)


@wp.func
def _largest_coordinate(photons: wp.ref[PhotonMap]) -> wp.float32:
    """Of all photons, by magnitude, from the root's boxes. The map is not empty."""
    largest = wp.float32(0.0)
    for axis in range(3):
        largest = wp.max(largest, wp.max(-wp.min(photons.nodes[axis]), wp.max(photons.nodes[axis + 3])))
    return largest


@wp.func
def _slab_enter(
    nodes: wp.array[vec8], row: wp.int32, axis: wp.int32, origin: wp.float32, inverse: wp.float32, grow: wp.float32
) -> vec8:
    """Where a line enters the slabs of a node's children, grown; inf for empty ones."""
    if inverse > 0.0:
        return (nodes[row + axis] - vec8(origin + grow)) * inverse
    return (nodes[row + 3 + axis] - vec8(origin - grow)) * inverse


@wp.func
def _slab_leave(
    nodes: wp.array[vec8], row: wp.int32, axis: wp.int32, origin: wp.float32, inverse: wp.float32, grow: wp.float32
) -> vec8:
    """Where a line leaves the slabs of a node's children, grown; -inf for empty ones."""
    if inverse > 0.0:
        return (nodes[row + 3 + axis] - vec8(origin - grow)) * inverse
    return (nodes[row + axis] - vec8(origin + grow)) * inverse


@wp.func
def _box_overlap(
    nodes: wp.array[vec8], row: wp.int32, origin: wp.vec3, inverse: wp.vec3, length: wp.float32, grow: wp.float32
) -> vec8:
    """At least 0 for the children whose grown boxes a stretch passes; NaN for some that an infinite one does not."""
    enter = vec8(0.0)
    leave = vec8(length)
    for axis in range(3):
        enter = wp.max(enter, _slab_enter(nodes, row, axis, origin[axis], inverse[axis], grow))
        leave = wp.min(leave, _slab_leave(nodes, row, axis, origin[axis], inverse[axis], grow))
    return leave - enter


@wp.func
def _leaf_margin(
    leaves: wp.array[vec8], row: wp.int32, origin: wp.vec3, direction: wp.vec3, medium: wp.int32, reach2: wp.float32
) -> vec8:
    """Above 0 for photons of the medium that may be within reach of the beam's line."""
    x = leaves[row + 0] - vec8(origin[0])
    y = leaves[row + 1] - vec8(origin[1])
    z = leaves[row + 2] - vec8(origin[2])
    t = dot8(x, y, z, direction)
    x = x - t * direction[0]
    y = y - t * direction[1]
    z = z - t * direction[2]
    distance2 = wp.cw_mul(x, x) + wp.cw_mul(y, y) + wp.cw_mul(z, z)
    other = leaves[row + 3] - vec8(wp.float32(medium))
    return wp.min(vec8(reach2) - distance2, vec8(0.25) - wp.cw_mul(other, other))


@wp.func
def _row3(rows: wp.array[vec8], row: wp.int32, lane: wp.int32) -> wp.vec3:
    """One vector out of three rows of eight."""
    return wp.vec3(rows[row + 0][lane], rows[row + 1][lane], rows[row + 2][lane])


@wp.func
def _quanta(x: wp.float64, unit: wp.float64) -> wp.int64:
    """A contribution in units, cut where it is too large for the sum."""
    return wp.int64(wp.rint(wp.clamp(x / unit, -_LARGEST_QUANTA, _LARGEST_QUANTA)))


@functools.cache
def _make_add_leaf(grids: bool) -> wp.Function:
    """The function `add_leaf`, for scenes where media have grids or not."""

    @wp.func
    def through_to(
        media: wp.ref[Media], beams: wp.ref[Beams], i: wp.int32, marks: wp.array[wp.float64], t: wp.float64
    ) -> wp.vec3:
        """Transmittance of a beam up to a distance on it."""
        medium = beams.medium[i]
        passed = wp.float32(t)
        if wp.static(grids):
            grid = media.density[medium]
            if grid >= 0:
                origin = beams.origin[i]
                passed = wp.float32(length_at(media.grids, grid, origin, beams.direction[i], beams.length[i], marks, t))
        return transmittance(media, medium, passed)

    @wp.func
    def scattered(
        photons: wp.ref[PhotonMap],
        media: wp.ref[Media],
        beams: wp.ref[Beams],
        i: wp.int32,
        leaf: wp.int32,
        lane: wp.int32,
        near: wp.vec2d,
        radius2: wp.float64,
        marks: wp.array[wp.float64],
    ) -> wp.vec3d:
        """What one photon scatters out of the beam's near end, by channel; `near` is from `closest_point`."""
        # Light turns from the reverse of where it came from to the reverse of the beam.
        cosine = wp.dot(_row3(photons.leaves, LEAF_ROWS * leaf + 6, lane), beams.direction[i])
        share = wp.float64(phase_value(media.g[beams.medium[i]], cosine)) * biweight(near[1], radius2)
        share /= share_inside(
            beams.direction[i], beams.start[i], beams.end[i], wp.float64(beams.length[i]), near[0], wp.sqrt(radius2)
        )
        through = through_to(media, beams, i, marks, near[0])
        flux = photons.flux[8 * leaf + lane]
        return wp.vec3d(
            wp.float64(flux[0]) * wp.float64(through[0]) * share,
            wp.float64(flux[1]) * wp.float64(through[1]) * share,
            wp.float64(flux[2]) * wp.float64(through[2]) * share,
        )

    @wp.func
    def add_photon(
        photons: wp.ref[PhotonMap],
        media: wp.ref[Media],
        cells: wp.ref[Cells],
        beams: wp.ref[Beams],
        i: wp.int32,
        leaf: wp.int32,
        lane: wp.int32,
        own_cell: wp.int32,
        radius2: wp.float64,
        unit: wp.float64,
        marks: wp.array[wp.float64],
    ) -> None:
        """Add a photon of a leaf if the beam passes it in its own cell."""
        origin = beams.origin[i]
        direction = beams.direction[i]
        near = closest_point(origin, direction, _row3(photons.leaves, LEAF_ROWS * leaf, lane))
        inside = near[1] < radius2 and near[0] >= _ZERO and near[0] < wp.float64(beams.length[i])
        if inside and cell_of(cells, point_at(origin, direction, near[0])) == own_cell:
            light = scattered(photons, media, beams, i, leaf, lane, near, radius2, marks)
            beams.red[i] = beams.red[i] + _quanta(light[0], unit)
            beams.green[i] = beams.green[i] + _quanta(light[1], unit)
            beams.blue[i] = beams.blue[i] + _quanta(light[2], unit)
            if wp.max(wp.abs(light)) > _LARGEST_QUANTA * unit:
                beams.clamped[i] = beams.clamped[i] + 1

    @wp.func
    def add_leaf(
        photons: wp.ref[PhotonMap],
        media: wp.ref[Media],
        cells: wp.ref[Cells],
        beams: wp.ref[Beams],
        i: wp.int32,
        leaf: wp.int32,
        own_cell: wp.int32,
        reach2: wp.float32,
        radius2: wp.float64,
        unit: wp.float64,
        scratch: wp.array[wp.int32],
        free: wp.int32,
        marks: wp.array[wp.float64],
    ) -> None:
        """Add the photons of a leaf that the beam passes in its own cell; scratch[free] and seven more are free."""
        margin = _leaf_margin(
            photons.leaves, LEAF_ROWS * leaf, beams.origin[i], beams.direction[i], beams.medium[i], reach2
        )
        end = wp.int32(free)
        for lane in range(8):
            scratch[end] = lane
            end += wp.int32(margin[lane] > 0.0)
        for n in range(free, end):
            add_photon(photons, media, cells, beams, i, leaf, scratch[n], own_cell, radius2, unit, marks)

    return add_leaf


@functools.cache
def make_add_beams(features: Features) -> wp.Kernel:
    """The kernel that adds what photons scatter into beams."""
    add_leaf = _make_add_leaf(features.grids)
    marks_of_beam = wp.constant(int(MARKS) + 1 if features.grids else 1)

    @made_for(features)
    def add_beams(
        photons: PhotonMap,
        media: Media,
        cells: Cells,
        beams: Beams,
        own_cell: wp.int32,
        radius: wp.float32,
        unit: wp.float64,
        offset: wp.int32,
    ) -> None:
        """Add what a cell's photons, its own and its ghosts, scatter into beams. Sums are refined in place.

        Args:
            photons: volume photons, at least all within radius + pad of the cell. What photon_map.build takes as their
                normal has the number of the medium, up to 2^24, as its x.
            own_cell: the cell, whose stretch of the beams is added.
            radius: of the beams [scene units], as for `sum_unit`; at least 1e-9 of the largest coordinate, so that
                float64 tells the distances.
            unit: of the sums; see `sum_unit`.
        """
        i = offset + wp.tid()
        stack = wp.zeros(shape=(_STACK,), dtype=wp.int32)
        marks = wp.zeros(shape=(marks_of_beam,), dtype=wp.float64)
        if beams.medium[i] >= 0 and beams.length[i] > 0.0 and photons.count > 0:
            origin = beams.origin[i]
            if wp.static(features.grids):
                grid = media.density[beams.medium[i]]
                if grid >= 0:
                    mark_beam(media.grids, grid, origin, beams.direction[i], beams.length[i], marks)
            inverse = inverse_direction(beams.direction[i])
            size = wp.max(wp.abs(origin)) + _largest_coordinate(photons) + radius
            reach = radius + _LEAF_PAD * size
            radius2 = wp.float64(radius) * wp.float64(radius)
            stacked = wp.int32(1)
            stack[0] = 0
            while stacked > 0:
                stacked -= 1
                node = stack[stacked]
                child = first_child(node, photons.fan_out)
                overlap = _box_overlap(
                    photons.nodes, NODE_ROWS * node, origin, inverse, beams.length[i], radius + _BOX_PAD * size
                )
                if child < photons.inner_count:
                    for c in range(8):
                        stack[stacked] = child + c
                        stacked += wp.int32(overlap[c] >= 0.0)
                else:
                    # Listed first: what is done with a leaf is long, and in the unrolled loop it would stand eight
                    # times.
                    end = wp.int32(stacked)
                    for c in range(8):
                        stack[end] = child + c - photons.inner_count
                        end += wp.int32(overlap[c] >= 0.0)
                    for n in range(stacked, end):
                        leaf = stack[n]
                        add_leaf(
                            photons,
                            media,
                            cells,
                            beams,
                            i,
                            leaf,
                            own_cell,
                            reach * reach,
                            radius2,
                            unit,
                            stack,
                            end,
                            marks,
                        )

    return add_beams
