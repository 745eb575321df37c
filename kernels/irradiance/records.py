"""Records of the irradiance cache: where their gather rays go, and what is made of what those bring back.

A record is the irradiance of one surface point about its shading normal n, with first derivatives and a radius within
which it may be used. Its hemisphere is cut into rows * columns strata of equal projected solid angle, one gather ray
each (Ward & Heckbert 1992, "Irradiance Gradients"); in each the radiance L is taken for constant.

* Irradiance: E = pi / M * sum of L, M = rows * columns.
* By the normal: E(n) is the integral of L (n · w) over directions w, so its derivative is that of L w, less what lies
  along n. It is the rotation gradient of Ward & Heckbert without their cross products, and where they take tan(theta)
  of a ray, whose variance has no bound towards the horizon, it is integrated over the stratum.
* By the position: what a ray meets stays where it is, so the walls between strata move as the nearer one of the two
  does (Ward & Heckbert; Křivánek & Gautron 2009, "Practical Global Illumination with Irradiance Caching"): a wall at
  theta- from the normal sweeps cos²(theta-) sin(theta-) d(phi) / r for each unit of a step towards it, a wall between
  columns (sin(theta+) - sin(theta-)) / r for each unit of a step across it. Walls around a ray that met nothing do not
  move with others that met nothing either.
* Radius: a share of the harmonic mean distance of what is seen (Ward, Rubinstein & Clear 1988); no more than a share of
  the least such distance, as behind the nearest thing the surface may be lit otherwise; no more than the gradient would
  use up the irradiance in (Křivánek & Gautron); all within given bounds. The least distance leaves out the outermost
  row: rays that graze a hollow or bumpy surface meet it next to the record, and it hides little there.

A ray that would leave below the geometric surface, as bent normals have it, is not shot: it carries no light, its
distance is negative, its walls do not move and it does not count in the mean distance.

Everything is summed by one thread in double, in the order of the strata.
"""

from __future__ import annotations

import functools
from typing import Any

import warp as wp

from wdpm.kernels.constants import PI
from wdpm.kernels.maths.directions import around
from wdpm.kernels.maths.elementary import atan2_of, sincos_of
from wdpm.kernels.maths.random import PURPOSE_RECORD, hash_combine, sample_2d, stream_of
from wdpm.kernels.maths.schlick import EVEN_SCHLICK
from wdpm.scenes.errors import WdpmError

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NOT_SHOT = wp.constant(wp.float32(-1.0))
"""Distance of a gather ray that would leave below the surface."""

_INF = wp.constant(wp.float32(float("inf")))
_LOW_WORD = wp.constant(wp.int64(0xFFFFFFFF))
_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))


@wp.struct
class Strata:
    """How hemispheres are cut, on one device; see `make_strata`. Angles are theta from the normal and phi about it."""

    rows: wp.int32
    columns: wp.int32
    chord: wp.float32  # integral of (cos phi, sin phi) over a column, as a factor of its centre: 2 sin(pi / columns)
    turn: wp.array[wp.float32]  # integral of sin²(theta) over each row
    wall: wp.array[wp.float32]  # cos²(theta) sin(theta) of each row's inner edge
    side: wp.array[wp.float32]  # integral of cos(theta) over each row
    centre: wp.array[wp.vec2]  # (cos phi, sin phi) of each column's middle
    edge: wp.array[wp.vec2]  # (cos phi, sin phi) of each column's first edge
    schlick: wp.array[wp.float32]  # mean of Schlick's weight over each row


@wp.func
def _turn_to(sine2: wp.float64) -> wp.float64:
    """Integral of sin²(theta) from 0 to where sin²(theta) is given."""
    sine = wp.sqrt(sine2)
    cosine = wp.sqrt(_ONE - sine2)
    theta = wp.float64(atan2_of(wp.float32(sine), wp.float32(cosine)))
    return wp.float64(0.5) * (theta - sine * cosine)


@wp.func
def _schlick_to(cosine: wp.float64) -> wp.float64:
    """Integral of (1 - c)^5 2 c over cosines c from 0."""
    m = _ONE - cosine
    m6 = m * m * m * m * m * m
    return (_ONE - m6) / wp.float64(3.0) - wp.float64(2.0) * (_ONE - m6 * m) / wp.float64(7.0)


@wp.kernel
def _fill_rows(
    rows: wp.int32,
    turn_out: wp.array[wp.float32],
    wall_out: wp.array[wp.float32],
    side_out: wp.array[wp.float32],
    schlick_out: wp.array[wp.float32],
) -> None:
    row = wp.tid()
    low = wp.float64(row) / wp.float64(rows)
    high = wp.float64(row + 1) / wp.float64(rows)
    turn_out[row] = wp.float32(_turn_to(high) - _turn_to(low))
    wall_out[row] = wp.float32((_ONE - low) * wp.sqrt(low))
    side_out[row] = wp.float32(wp.sqrt(high) - wp.sqrt(low))
    above = _schlick_to(wp.sqrt(_ONE - low))
    schlick_out[row] = wp.float32((above - _schlick_to(wp.sqrt(_ONE - high))) * wp.float64(rows))


@wp.kernel
def _fill_columns(
    columns: wp.int32, chord_out: wp.array[wp.float32], centre_out: wp.array[wp.vec2], edge_out: wp.array[wp.vec2]
) -> None:
    column = wp.tid()
    width = 2.0 * PI / wp.float32(columns)
    centre = sincos_of((wp.float32(column) + 0.5) * width)
    edge = sincos_of(wp.float32(column) * width)
    centre_out[column] = wp.vec2(centre[1], centre[0])
    edge_out[column] = wp.vec2(edge[1], edge[0])
    if column == 0:
        chord_out[0] = 2.0 * sincos_of(0.5 * width)[0]


@functools.cache
def make_strata(rows: int, columns: int, device: str = "cpu") -> Any:
    """Strata of rows * columns gather rays.

    With columns about pi times as many as rows, strata are about as long as wide (Ward & Heckbert 1992).

    Raises:
        WdpmError: fewer than 1 row or 3 columns: no derivative can be told.
    """
    if rows < 1 or columns < 3:
        raise WdpmError(f"irradiance records: {rows} x {columns} strata, expected at least 1 row and 3 columns")
    strata = Strata()
    strata.rows, strata.columns = rows, columns
    of_rows = [wp.empty(rows, dtype=wp.float32, device=device) for _ in range(4)]
    strata.turn, strata.wall, strata.side, strata.schlick = of_rows
    strata.centre, strata.edge = (wp.empty(columns, dtype=wp.vec2, device=device) for _ in range(2))
    chord = wp.empty(1, dtype=wp.float32, device=device)
    wp.launch(_fill_rows, rows, inputs=[rows, *of_rows], device=device)
    wp.launch(_fill_columns, columns, inputs=[columns, chord, strata.centre, strata.edge], device=device)
    strata.chord = float(chord.numpy()[0])
    return strata


@wp.func
def stratum_direction(
    normal: wp.vec3, row: wp.int32, column: wp.int32, rows: wp.int32, columns: wp.int32, u: wp.vec2
) -> wp.vec3:
    """A unit direction of one stratum, with pdf_solid_angle = M cos / pi there.

    Args:
        normal: the shading normal, unit.
        u: a point of the unit square.
    """
    sine2 = (wp.float32(row) + u[0]) / wp.float32(rows)
    phi = sincos_of(2.0 * PI * (wp.float32(column) + u[1]) / wp.float32(columns))
    sine = wp.sqrt(sine2)
    return around(normal, wp.vec3(sine * phi[1], sine * phi[0], wp.sqrt(wp.max(0.0, 1.0 - sine2))))


@wp.func
def record_point(seed: wp.uint32, number: wp.int64, stratum: wp.int32, turn: wp.int32) -> wp.vec2:
    """Where in its stratum a record's gather ray lies, a point of the unit square.

    Args:
        turn: of the ray among those of its stratum, from 0: they are stratified among themselves.
    """
    stream = stream_of(seed, PURPOSE_RECORD, wp.uint32(number & _LOW_WORD), wp.int32(number >> wp.int64(32)))
    return sample_2d(wp.uint32(turn), hash_combine(stream, wp.uint32(stratum)))


@wp.kernel
def record_directions(
    strata: Strata,
    number: wp.array[wp.int64],
    normal: wp.array[wp.vec3],
    shading_normal: wp.array[wp.vec3],
    seed: wp.uint32,
    record: wp.array[wp.int32],
    stratum: wp.array[wp.int32],
    turn: wp.array[wp.int32],
    offset: wp.int32,
    direction_out: wp.array[wp.vec3],
    distance_out: wp.array[wp.float32],
) -> None:
    """Gather rays of N records, one thread a ray.

    Args:
        number: of each record: what its random numbers are a function of, with the seed.
        normal: unit geometric normals on the seen side [N].
        shading_normal: unit [N].
        record: that each ray is of [R].
        stratum: of the hemisphere that it goes through: row * columns + column [R].
        turn: its number among those of its stratum [R].
        direction_out: unit [R].
        distance_out: inf where there is a ray to be shot, NOT_SHOT where it would leave below the surface [R].
    """
    i = offset + wp.tid()
    site = record[i]
    row = stratum[i] // strata.columns
    column = stratum[i] - row * strata.columns
    u = record_point(seed, number[site], stratum[i], turn[i])
    direction = stratum_direction(shading_normal[site], row, column, strata.rows, strata.columns, u)
    direction_out[i] = direction
    distance_out[i] = NOT_SHOT
    if wp.dot(direction, normal[site]) > 0.0:
        distance_out[i] = _INF


@wp.func
def _wall_speed(a: wp.float32, b: wp.float32, least: wp.float32) -> wp.float64:
    """Angle [radians] by which a wall between two rays' strata moves for each unit of a step across the line of sight.

    Args:
        a, b: distances of what the two rays met.
        least: distances below count as this: nearer things change faster than records can follow.
    """
    if a < 0.0 or b < 0.0:
        return _ZERO
    return _ONE / wp.float64(wp.max(wp.min(a, b), least))


@wp.func
def _in_world(along_x: wp.vec3d, along_y: wp.vec3d, normal: wp.vec3) -> wp.mat33:
    """Derivatives along the axes of the frame of `around` as rows of world vectors, one for each channel."""
    x = wp.vec3d(around(normal, wp.vec3(1.0, 0.0, 0.0)))
    y = wp.vec3d(around(normal, wp.vec3(0.0, 1.0, 0.0)))
    return wp.mat33(wp.outer(along_x, x) + wp.outer(along_y, y))


@wp.func
def _length2d(x: wp.float64, y: wp.float64) -> wp.float64:
    return wp.sqrt(x * x + y * y)


@wp.struct
class Bounds:
    """What bounds the radius of records.

    Attributes:
        reach: share of the harmonic mean distance (Ward's a).
        clearance: the same of the least distance: in corners that is what counts.
        least, most: 0 < least <= most [scene units] [N].
    """

    reach: wp.float32
    clearance: wp.float32
    least: wp.array[wp.float32]
    most: wp.array[wp.float32]


@wp.struct
class MadeRecords:
    """What is known of N records.

    Attributes:
        irradiance: on a surface about the shading normal.
        rotation: row c is the derivative of channel c by the normal: E(n') = E + rotation (n' - n).
        translation: row c is that by the position: E(x') = E + translation (x' - x) [1 / scene units]. Both have
            nothing along the normal. Shortened where a channel would be used up within the radius.
        grazing: how much the light grazes the surface, all channels together (kernels.maths.schlick).
        radius: [scene units].
        nearest: the least distance, without the outermost row; inf if nothing was met [scene units].
    """

    irradiance: wp.array[wp.vec3]
    rotation: wp.array[wp.mat33]
    translation: wp.array[wp.mat33]
    grazing: wp.array[wp.float32]
    radius: wp.array[wp.float32]
    nearest: wp.array[wp.float32]


@wp.kernel
def make_records(
    strata: Strata,
    radiance: wp.array[wp.vec3],
    distance: wp.array[wp.float32],
    shading_normal: wp.array[wp.vec3],
    bounds: Bounds,
    offset: wp.int32,
    made_out: MadeRecords,
) -> None:
    """N records of what their gather rays brought back, one thread a record.

    Args:
        radiance: finite, what came along each ray, 0 for rays not shot [N * M].
        distance: of what each ray met [scene units], inf if nothing, negative if not shot [N * M].
        shading_normal: unit [N].
    """
    i = offset + wp.tid()
    rows = strata.rows
    columns = strata.columns
    first = i * rows * columns
    least = bounds.least[i]
    total = wp.vec3d()
    turn_x = wp.vec3d()
    turn_y = wp.vec3d()
    shift_x = wp.vec3d()
    shift_y = wp.vec3d()
    grazing = _ZERO
    shot = wp.int32(0)
    inverse = wp.float64(0.0)
    nearest = wp.float32(_INF)
    for row in range(rows):
        turn = wp.float64(strata.turn[row])
        wall = wp.float64(strata.wall[row] * strata.chord)
        side = wp.float64(strata.side[row])
        schlick = wp.float64(strata.schlick[row])
        for column in range(columns):
            k = first + row * columns + column
            value = wp.vec3d(radiance[k])
            d = distance[k]
            if d >= 0.0:
                shot += 1
                inverse += _ONE / wp.float64(d)
                if row + 1 < rows or rows == 1:
                    nearest = wp.min(nearest, d)
            total += value
            grazing += schlick * (value[0] + value[1] + value[2])
            centre = strata.centre[column]
            out_x = wp.float64(centre[0])
            out_y = wp.float64(centre[1])
            turn_x += value * (turn * out_x)
            turn_y += value * (turn * out_y)
            if row > 0:
                step = (value - wp.vec3d(radiance[k - columns])) * (wall * _wall_speed(d, distance[k - columns], least))
                shift_x += step * out_x
                shift_y += step * out_y
            before = k - 1
            if column == 0:
                before = k + columns - 1
            edge = strata.edge[column]
            step = (value - wp.vec3d(radiance[before])) * (side * _wall_speed(d, distance[before], least))
            shift_x -= step * wp.float64(edge[1])
            shift_y += step * wp.float64(edge[0])
    chord = wp.float64(strata.chord)
    brightness = total[0] + total[1] + total[2]
    if brightness > _ZERO:
        grazing = grazing / brightness - wp.float64(EVEN_SCHLICK)
    total = total * (wp.float64(PI) / wp.float64(rows * columns))
    turn_x = turn_x * chord
    turn_y = turn_y * chord

    radius = wp.float64(bounds.clearance) * wp.float64(nearest)
    if inverse > _ZERO:
        radius = wp.min(radius, wp.float64(bounds.reach) * wp.float64(shot) / inverse)
    slope = wp.float64(0.0)
    for c in range(3):
        slope += _length2d(shift_x[c], shift_y[c])
    if slope > _ZERO:
        radius = wp.min(radius, (total[0] + total[1] + total[2]) / slope)
    radius = wp.clamp(radius, wp.float64(least), wp.float64(bounds.most[i]))
    for c in range(3):
        lost = _length2d(shift_x[c], shift_y[c]) * radius
        if lost > total[c]:
            shift_x[c] = shift_x[c] * (total[c] / lost)
            shift_y[c] = shift_y[c] * (total[c] / lost)

    normal = shading_normal[i]
    made_out.irradiance[i] = wp.vec3(total)
    made_out.rotation[i] = _in_world(turn_x, turn_y, normal)
    made_out.translation[i] = _in_world(shift_x, shift_y, normal)
    made_out.grazing[i] = wp.float32(grazing)
    made_out.radius[i] = wp.float32(radius)
    made_out.nearest[i] = nearest
