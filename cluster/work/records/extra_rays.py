"""Gather rays that a record gets on top of one a stratum, where its radiance changes from stratum to stratum.

What a record gets wrong shows as a blotch as wide as the record reaches, which no number of camera samples lessens. How
wrong it is, its own rays tell: a stratum's radiance is that of one ray, and spreads about as much as its neighbours'
rays differ from each other. Rays are shared out in proportion to that spread (Neyman 1934), as many as bring the
record's relative error down to what is asked for. The ray of a stratum itself has no say in how many more it gets: a
chance hit of a small lamp that draws others, or keeps them away, is diluted more than a chance miss, or less, and the
mean of all records would be off. Nor do their numbers know of each other (kernels.maths.sample_numbers).

What is smaller than a stratum escapes the rays around it as well: the inside of a lamp's cup, a patch of sun far away.
One record in ten meets it, counts it ten times over, and is a bright blotch among dark ones. Where lights shine first
is known, though (cluster.plan.lit_places), and with it what comes from there through each stratum if nothing stands in
between: what of that the rays around have not met adds to the spread that they tell.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels import columns
from wdpm.kernels.irradiance.ray_shares import (
    ByStratum,
    irradiance_errors,
    mean_radiance,
    number_rays,
    share_out_rays,
)
from wdpm.kernels.launch import Launcher

Values = NDArray[np.float64]

GRAIN = 8
"""Records that are worth a launch of their own."""

GOLDEN = (5.0**0.5 - 1.0) / 2.0
"""Its multiples, less what is whole of them, are even between 0 and 1: numbers that are rounded by them keep their
sum."""


@dataclass(frozen=True, eq=False)
class ExtraRays:
    """How many rays the strata of N records get more.

    Attributes:
        counts: of each stratum of each record, int64, shape [N, strata].
        begins: place of each record's first one, where all lie one after another, int64, shape [N].
        total: of all of them.
    """

    counts: NDArray[np.int64]
    begins: NDArray[np.int64]
    total: int

    @classmethod
    def of(cls, counts: NDArray[np.int64], of_records: NDArray[np.int64]) -> ExtraRays:
        """Such counts, and what they are together of each record."""
        ends = of_records.cumsum()
        return cls(counts, ends - of_records, int(ends[-1]) if len(ends) else 0)


def no_extra_rays(records: int, strata: int) -> ExtraRays:
    """None for anybody."""
    return ExtraRays(np.zeros((records, strata), np.int64), np.zeros(records, np.int64), 0)


def extra_rays(
    launcher: Launcher,
    strata: tuple[int, int],
    radiance: Values,
    unoccluded: NDArray[np.float32],
    distance: NDArray[np.float32],
    tolerance: float,
    most: int,
) -> ExtraRays:
    """How many rays each stratum of some records gets more.

    Args:
        strata: rows and columns of hemispheres.
        radiance: finite, of each stratum's ray, shape [N * strata, 3].
        unoccluded: radiance that lit places would send if nothing stood in between, mean of RGB, shape [N * strata].
        distance: of what each ray met; negative if it was not shot: that stratum gets none. Shape [N * strata].
        tolerance: relative standard error of the irradiance that is aimed at.
        most: extra rays of a record, about.
    """
    each = strata[0] * strata[1]
    records, device = len(radiance) // each, launcher.device
    counts = columns.outputs({"count": wp.int64}, len(radiance), device)["count"]
    of_records = columns.outputs({"all": wp.int64}, records, device)["all"]
    launcher(
        share_out_rays,
        records,
        grain=GRAIN,
        rows=strata[0],
        columns=strata[1],
        radiance=columns.array_over(radiance, wp.vec3d, device),
        unoccluded=columns.array_over(unoccluded, wp.float32, device),
        distance=columns.array_over(distance, wp.float32, device),
        tolerance=tolerance,
        most=float(most + each),
        rounding=columns.array_over(_rounding(each), wp.float64, device),
        room=columns.empty(ByStratum, len(radiance), device),
        count_out=counts,
        all_out=of_records,
    )
    return ExtraRays.of(counts.numpy().reshape(records, each), of_records.numpy())


@functools.cache
def _rounding(strata: int) -> Values:
    rounding: Values = np.arange(1, strata + 1, dtype=np.float64) * GOLDEN % 1.0
    rounding.flags.writeable = False
    return rounding


def numbered(
    launcher: Launcher, extra: ExtraRays, by_number: NDArray[np.int32], following: int
) -> list[NDArray[np.int32]]:
    """Record, number, stratum and turn of each extra ray, as record_wave.GatherRays has them.

    Args:
        by_number: strata in the order of their first rays' numbers, shape [strata].
        following: the number after these.
    """
    (records, strata), device = extra.counts.shape, launcher.device
    dtypes = dict.fromkeys(("record_out", "ray_out", "stratum_out", "turn_out"), wp.int32)
    out = columns.outputs(dtypes, extra.total, device)
    launcher(
        number_rays,
        records,
        grain=GRAIN,
        strata=strata,
        count=columns.array_over(extra.counts.reshape(-1), wp.int64, device),
        begin=columns.array_over(extra.begins, wp.int64, device),
        by_number=columns.array_over(by_number, wp.int32, device),
        next_number=following,
        number=columns.integers(extra.counts.size, device),
        **out,
    )
    return [column.numpy() for column in out.values()]


def means(launcher: Launcher, radiance: Values, extra: ExtraRays, further: Values) -> Values:
    """Mean radiance of each stratum, of its first ray and the others, shape [N * strata, 3].

    Args:
        radiance: of the first rays, shape [N * strata, 3].
        further: of the extra rays, in the order of `numbered`, shape [extra.total, 3].
    """
    (records, strata), device = extra.counts.shape, launcher.device
    mean = columns.outputs({"mean": wp.vec3d}, len(radiance), device)["mean"]
    launcher(
        mean_radiance,
        records,
        grain=GRAIN,
        strata=strata,
        radiance=columns.array_over(radiance, wp.vec3d, device),
        count=columns.array_over(extra.counts.reshape(-1), wp.int64, device),
        begin=columns.array_over(extra.begins, wp.int64, device),
        further=columns.array_over(further, wp.vec3d, device),
        radiance_out=mean,
    )
    together: Values = mean.numpy()
    return together


def standard_errors(
    launcher: Launcher, strata: tuple[int, int], radiance: Values, counts: NDArray[np.int64]
) -> NDArray[np.float32]:
    """Of the irradiance of records, as the spread of their strata tells it, shape [N].

    It is an upper bound, about: neighbours differ by how light changes from stratum to stratum, too. A stratum spreads
    as those around it do, or as it differs from these: one ray that by chance meets the inside of a lamp, and has drawn
    no others to it, is the error of the whole record. (Rays are shared out without it; errors only tell who is to be
    averaged with whom.)

    Args:
        strata: rows and columns of hemispheres.
        radiance: mean of each stratum's rays, shape [N * strata, 3].
        counts: extra rays of each, shape [N, strata].
    """
    device = launcher.device
    error = columns.outputs({"error": wp.float32}, len(counts), device)["error"]
    launcher(
        irradiance_errors,
        len(counts),
        grain=GRAIN,
        rows=strata[0],
        columns=strata[1],
        radiance=columns.array_over(radiance, wp.vec3d, device),
        count=columns.array_over(counts.reshape(-1), wp.int64, device),
        grey=columns.outputs({"grey": wp.float64}, len(radiance), device)["grey"],
        error_out=error,
    )
    errors: NDArray[np.float32] = error.numpy()
    return errors
