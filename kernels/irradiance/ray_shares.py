"""How many gather rays each stratum of a record gets more, which these are, and what all of them bring together.

What is worked out here is told of where it is asked for (cluster/work/records/extra_rays.py). One thread has a record,
and adds in double, in the order of the strata. Columns of a hemisphere go round; its first and last row have no
neighbours beyond.
"""

from __future__ import annotations

import math

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

PEAK = wp.constant(wp.float64(2.0))
"""Standard deviation of what one ray brings through a stratum, over its mean, if all comes from a fifth of it."""

_ZERO = wp.constant(wp.float64(0.0))
_HALF = wp.constant(wp.float64(0.5))
_ONE = wp.constant(wp.float64(1.0))
_THREE = wp.constant(wp.float64(3.0))
_PI = wp.constant(wp.float64(math.pi))
_MOST = wp.constant(wp.float32(3.4028235e38))  # of float32, where lamps are as bright as can be


@wp.struct
class ByStratum:
    """Room for what each stratum of N records has [N * M]."""

    grey: wp.array[wp.float64]  # radiance of its ray, mean of RGB
    promised: wp.array[wp.float64]  # radiance that lit places would send, mean of RGB
    spread: wp.array[wp.float64]  # standard deviation of what a ray through it brings


@wp.func
def _grey(radiance: wp.vec3d) -> wp.float64:
    return (radiance[0] + radiance[1] + radiance[2]) / _THREE


@wp.func
def _beside(row: wp.int32, rows: wp.int32) -> wp.float64:
    """How many strata are around one of a row."""
    return wp.float64(3 * (wp.min(row + 2, rows) - wp.max(row - 1, 0)) - 1)


@wp.func
def _around(
    values: wp.array[wp.float64], first: wp.int32, row: wp.int32, column: wp.int32, rows: wp.int32, columns: wp.int32
) -> wp.vec2d:
    """Sums of what is around a stratum, without itself: of the values and of their squares.

    Args:
        first: place of the record's first stratum.
    """
    left = column - 1
    if column == 0:
        left = columns - 1
    right = column + 1
    if right == columns:
        right = 0
    total = wp.float64(0.0)
    squares = wp.float64(0.0)
    for at in range(wp.max(row - 1, 0), wp.min(row + 2, rows)):
        line = first + at * columns
        value = values[line + left]
        total += value
        squares += value * value
        if at != row:
            value = values[line + column]
            total += value
            squares += value * value
        value = values[line + right]
        total += value
        squares += value * value
    return wp.vec2d(total, squares)


@wp.func
def _variance(sums: wp.vec2d, beside: wp.float64) -> wp.float64:
    """Of what is around a stratum."""
    return wp.max((sums[1] - sums[0] * sums[0] / beside) / wp.max(beside - _ONE, _ONE), _ZERO)


@wp.func
def _spread(
    room: ByStratum, first: wp.int32, row: wp.int32, column: wp.int32, rows: wp.int32, columns: wp.int32
) -> wp.float64:
    """Standard deviation of what a ray through a stratum brings, as what is around it tells.

    Half of what lit places would send through a stratum counts there, and half where it would come through those
    around: few places tell of each. What of that the rays around have not met is unseen.
    """
    beside = _beside(row, rows)
    sums = _around(room.grey, first, row, column, rows, columns)
    near = wp.sqrt(_variance(sums, beside))
    promised = _around(room.promised, first, row, column, rows, columns)
    smooth = _HALF * room.promised[first + row * columns + column] + _HALF * promised[0] / beside
    unseen = PEAK * wp.max(smooth - sums[0] / beside, _ZERO)
    return wp.sqrt(near * near + unseen * unseen)


@wp.kernel
def share_out_rays(
    rows: wp.int32,
    columns: wp.int32,
    radiance: wp.array[wp.vec3d],
    unoccluded: wp.array[wp.float32],
    distance: wp.array[wp.float32],
    tolerance: wp.float64,
    most: wp.float64,
    rounding: wp.array[wp.float64],
    room: ByStratum,
    offset: wp.int32,
    count_out: wp.array[wp.int64],
    all_out: wp.array[wp.int64],
) -> None:
    """How many rays the strata of N records get more.

    Args:
        radiance: finite, what each stratum's ray brought [N * M].
        unoccluded: radiance that lit places would send if nothing stood in between, mean of RGB [N * M].
        distance: of what each ray met; negative if it was not shot [N * M].
        tolerance: relative standard error of the irradiance that is aimed at.
        most: rays of a record in all, about.
        rounding: of each stratum's number, from 0 to 1 [M].
        count_out: of each stratum [N * M].
        all_out: of each record [N].
    """
    i = offset + wp.tid()
    strata = rows * columns
    first = i * strata
    total = wp.float64(0.0)
    for k in range(strata):
        room.grey[first + k] = _grey(radiance[first + k])
        room.promised[first + k] = wp.float64(wp.min(unoccluded[first + k], _MOST))
        total += room.grey[first + k]
    spreads = wp.float64(0.0)
    for row in range(rows):
        for column in range(columns):
            spread = _spread(room, first, row, column, rows, columns)
            room.spread[first + row * columns + column] = spread
            spreads += spread
    every = wp.int64(0)
    for row in range(rows):
        beside = _beside(row, rows)
        for column in range(columns):
            k = first + row * columns + column
            count = wp.int64(0)
            if distance[k] >= 0.0:
                # Both sums as they would be if the stratum were like what is around it: its own ray has no part in it.
                near = _around(room.grey, first, row, column, rows, columns)
                near_spread = _around(room.spread, first, row, column, rows, columns)
                its_total = total - room.grey[k] + near[0] / beside
                its_spreads = spreads - near_spread[0] + beside * room.spread[k]
                # With n rays in proportion to the spreads s of all strata the error of the sum is (sum of s) / sqrt(n).
                wanted = wp.float64(0.0)
                if its_total > _ZERO:
                    wanted = its_spreads / (tolerance * its_total)
                share = wp.float64(0.0)
                if its_spreads > _ZERO:
                    share = room.spread[k] / its_spreads
                asked = wp.min(wanted * wanted, most) * share - _ONE  # each has one ray already
                count = wp.int64(wp.floor(wp.max(asked, _ZERO) + rounding[k - first]))
            count_out[k] = count
            every += count
    all_out[i] = every


@wp.kernel
def number_rays(
    strata: wp.int32,
    count: wp.array[wp.int64],
    begin: wp.array[wp.int64],
    by_number: wp.array[wp.int32],
    next_number: wp.int32,
    number: wp.array[wp.int32],
    offset: wp.int32,
    record_out: wp.array[wp.int32],
    ray_out: wp.array[wp.int32],
    stratum_out: wp.array[wp.int32],
    turn_out: wp.array[wp.int32],
) -> None:
    """The further rays of N records: those of a stratum follow each other, as strata and records do.

    Args:
        count: of each stratum [N * M].
        begin: place of each record's first ray among all [N].
        by_number: strata in the order of their first rays' numbers, in which the others are numbered [M].
        next_number: after those of the first rays.
        number: room for that of each stratum's first further ray [N * M].
        record_out, ray_out, stratum_out, turn_out: as cluster.work.records.record_wave.GatherRays has them [R].
    """
    i = offset + wp.tid()
    first = i * strata
    following = next_number
    for k in range(strata):
        stratum = by_number[k]
        number[first + stratum] = following
        following += wp.int32(count[first + stratum])
    place = wp.int32(begin[i])
    for stratum in range(strata):
        for turn in range(wp.int32(count[first + stratum])):
            record_out[place] = i
            ray_out[place] = number[first + stratum] + turn
            stratum_out[place] = stratum
            turn_out[place] = turn + 1  # the first ray went before
            place += 1


@wp.kernel
def mean_radiance(
    strata: wp.int32,
    radiance: wp.array[wp.vec3d],
    count: wp.array[wp.int64],
    begin: wp.array[wp.int64],
    further: wp.array[wp.vec3d],
    offset: wp.int32,
    radiance_out: wp.array[wp.vec3d],
) -> None:
    """Mean radiance of the strata of N records, of their first rays and the further ones.

    Args:
        radiance: of the first ray of each [N * M].
        count, begin: as number_rays has them.
        further: of the others, in the order of number_rays [R].
        radiance_out: [N * M].
    """
    i = offset + wp.tid()
    place = wp.int32(begin[i])
    for k in range(i * strata, i * strata + strata):
        more = wp.int32(count[k])
        added = wp.vec3d()
        for _ in range(more):
            added += further[place]
            place += 1
        radiance_out[k] = (radiance[k] + added) / (wp.float64(more) + _ONE)


@wp.kernel
def irradiance_errors(
    rows: wp.int32,
    columns: wp.int32,
    radiance: wp.array[wp.vec3d],
    count: wp.array[wp.int64],
    grey: wp.array[wp.float64],
    offset: wp.int32,
    error_out: wp.array[wp.float32],
) -> None:
    """Standard errors of the irradiance of N records, as the spread of their strata tells it.

    Args:
        radiance: mean of each stratum's rays [N * M].
        count: of each stratum's further rays [N * M].
        grey: room for the mean of RGB of each [N * M].
        error_out: mean of RGB [N].
    """
    i = offset + wp.tid()
    strata = rows * columns
    first = i * strata
    for k in range(first, first + strata):
        grey[k] = _grey(radiance[k])
    variance = wp.float64(0.0)
    for row in range(rows):
        beside = _beside(row, rows)
        for column in range(columns):
            k = first + row * columns + column
            sums = _around(grey, first, row, column, rows, columns)
            near = wp.sqrt(_variance(sums, beside))
            off = grey[k] - sums[0] / beside
            variance += wp.max(near * near, off * off) / (wp.float64(count[k]) + _ONE)
    error_out[i] = wp.float32(wp.sqrt(variance) * (_PI / wp.float64(strata)))
