"""Where paths go on from diffuse surfaces to find caustics, as a render has learnt it (cluster.plan.caustics).

By the cosine alone a path goes from a diffuse surface to where a mirror, or a metal that is nearly one, shows a small
bright lamp about once in a hundred thousand times, and then is a hundred thousand times too bright: a firefly. Photons
know where caustics come from. So in each region of space a part of the rays that go on by diffuse parts is drawn from
lobes, one for each photon that landed there: about the direction to a target, which for a flat mirror is the lamp's
image behind it, and so stays right some way from where the photon landed. The rest goes by the cosine, and all
count by the mean of both densities (the one-sample balance heuristic, Veach & Guibas 1995): nothing is left out, and
no mean changes.

A lobe's density falls linearly with 1 - cos to nothing at its rim. A narrow lobe has a wider one about it, for what
photons of a short pilot have missed.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.constants import PI
from wdpm.kernels.maths.directions import around, concentric_disk
from wdpm.kernels.rays import cells
from wdpm.kernels.rays.cells import Cells, cell_of
from wdpm.kernels.rays.lanes import cones_met, lowest_bit

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

WIDE = wp.constant(wp.float32(20.0))
"""Of a lobe's wider one, 1 - cos at the rim over that of the narrow one: four to five times the angle."""

WIDE_SHARE = wp.constant(wp.float32(0.25))
"""Of a lobe's rays that are drawn from the wider one."""

HEMISPHERE = wp.constant(wp.float32(1.0))
"""1 - cos at the rim of the widest lobe there can be."""

_NO_COSINE = 4.0
"""Squared, of a cone that no direction meets."""

_BELOW_ONE = wp.constant(wp.float32(1 - 2.0**-24))


@wp.struct
class CausticGuide:
    """What was learnt, on a device; of 0 regions where nothing was.

    Attributes:
        regions: the leaves of a kd-tree.
        first: of each region's lobes, and one more past the last, [regions + 1]: multiples of eight, as lobes that are
            never met fill up each region's last block.
        target: of each lobe, [lobes].
        cones: within which the lobes lie with their wider ones, in blocks of eight: see lanes.cones_met.
        rim: 1 - cos of the angle between a lobe's middle and its rim, [lobes].
        part: of the rays that go on in a region, drawn from its lobes, [regions].
        share: probability of a lobe in its region, [lobes].
        until: the same of all lobes of the region up to and with it, [lobes].
    """

    regions: Cells
    first: wp.array[wp.int32]
    target: wp.array[wp.vec3]
    cones: wp.array[wp.float32]
    rim: wp.array[wp.float32]
    part: wp.array[wp.float32]
    share: wp.array[wp.float32]
    until: wp.array[wp.float32]


def upload(
    axis: NDArray[np.int32],
    split: NDArray[np.float32],
    first: NDArray[np.int32],
    target: NDArray[np.float32],
    rim: NDArray[np.float32],
    share: NDArray[np.float32],
    part: NDArray[np.float32],
    device: str,
) -> CausticGuide:
    """A guide on a device.

    Args:
        axis, split: of the regions' kd-tree, in heap order, as of the top tree.
        first, target, rim, share, part: see CausticGuide; no `first` for no regions.
    """
    if len(first) < 2:
        return _nothing(device)
    guide = CausticGuide()
    guide.regions = cells.upload(axis, split, 0.0, device)
    guide.regions.count = len(first) - 1
    counts = first[1:].astype(np.int64) - first[:-1]
    ends = np.concatenate([[0], np.cumsum(-(-counts // 8) * 8)])
    row = np.arange(len(share)) + np.repeat(ends[:-1] - first[:-1], counts)
    wide = np.minimum(float(WIDE) * rim.astype(np.float64), float(HEMISPHERE))
    whole = np.concatenate([np.zeros(1), np.cumsum(share.astype(np.float64))])
    until = whole[1:] - np.repeat(whole[first[:-1]], counts)
    until[first[1:][counts > 0] - 1] = 1.0  # whatever sums were rounded to

    def in_blocks(values: NDArray[Any], never: float) -> NDArray[np.float32]:
        filled = np.full((int(ends[-1]), *values.shape[1:]), never, np.float32)
        filled[row] = values
        return filled

    targets = in_blocks(target, 0.0)
    cones = np.column_stack([targets, in_blocks((1.0 - wide) ** 2, _NO_COSINE)])
    floats = {
        "cones": np.ascontiguousarray(cones.reshape(-1, 8, 4).transpose(0, 2, 1)).reshape(-1),
        "rim": in_blocks(rim, 1.0),
        "share": in_blocks(share, 0.0),
        "until": in_blocks(until, 1.0),
        "part": np.ascontiguousarray(part),
    }
    guide.first = wp.array(ends.astype(np.int32), dtype=wp.int32, device=device)
    guide.target = wp.array(targets, dtype=wp.vec3, device=device)
    for name, table in floats.items():
        setattr(guide, name, wp.array(table, dtype=wp.float32, device=device))
    return guide


@functools.cache
def _nothing(device: str) -> CausticGuide:
    """A guide of no regions: of most views, of which a plan looks through nine."""
    guide = CausticGuide()
    guide.regions = cells.upload(np.zeros(0, np.int32), np.zeros(0, np.float32), 0.0, device)
    guide.regions.count = 0
    for name, kind in {"first": wp.int32, "target": wp.vec3}.items():
        setattr(guide, name, wp.zeros(1, dtype=kind, device=device))
    for name in ("cones", "rim", "part", "share", "until"):
        setattr(guide, name, wp.zeros(1, dtype=wp.float32, device=device))
    return guide


@wp.func
def lobes_at(guide: wp.ref[CausticGuide], position: wp.vec3) -> wp.int32:
    """The region of a place, if it has lobes; -1 else."""
    if guide.regions.count == 0:
        return -1
    region = cell_of(guide.regions, position)
    if guide.first[region] == guide.first[region + 1]:
        return -1
    return region


@wp.func
def _density(off: wp.float32, rim: wp.float32) -> wp.float32:
    """Of one lobe, at 1 - cos `off` its middle: pdf_solid_angle."""
    if off >= rim:
        return 0.0
    return (1.0 - off / rim) / (PI * rim)


@wp.func
def guided_pdf(guide: wp.ref[CausticGuide], region: wp.int32, position: wp.vec3, direction: wp.vec3) -> wp.float32:
    """pdf_solid_angle with which `guided_direction` makes a direction of length 1."""
    pdf = wp.float32(0.0)
    for block in range(guide.first[region] / 8, guide.first[region + 1] / 8):
        mask = cones_met(guide.cones, block, position, direction)
        while mask != 0:
            lane = lowest_bit(mask)
            mask = mask & (mask - 1)
            i = 8 * block + lane
            # Half the squared difference of directions is 1 - cos, to float32's precision also where that is tiny.
            apart = wp.normalize(guide.target[i] - position) - direction
            off = 0.5 * wp.dot(apart, apart)
            rim = guide.rim[i]
            wide = wp.min(WIDE * rim, HEMISPHERE)
            pdf += guide.share[i] * ((1.0 - WIDE_SHARE) * _density(off, rim) + WIDE_SHARE * _density(off, wide))
    return pdf


@wp.func
def guided_direction(guide: wp.ref[CausticGuide], region: wp.int32, position: wp.vec3, u: wp.vec2) -> wp.vec3:
    """A direction drawn from the lobes of a region. What choices leave of u[0] is as good as a fresh number."""
    low = guide.first[region]
    first = low
    high = guide.first[region + 1] - 1
    while low < high:
        middle = (low + high) // 2
        if guide.until[middle] <= u[0]:
            low = middle + 1
        else:
            high = middle
    before = wp.float32(0.0)
    if low > first:
        before = guide.until[low - 1]
    left = wp.float32(0.0)
    if guide.until[low] > before:
        left = wp.clamp((u[0] - before) / (guide.until[low] - before), 0.0, _BELOW_ONE)
    rim = guide.rim[low]
    if left < WIDE_SHARE:
        left = left / WIDE_SHARE
        rim = wp.min(WIDE * rim, HEMISPHERE)
    else:
        left = (left - WIDE_SHARE) / (1.0 - WIDE_SHARE)
    d = concentric_disk(wp.vec2(wp.min(left, _BELOW_ONE), u[1]))
    square = d[0] * d[0] + d[1] * d[1]
    off = rim * (1.0 - wp.sqrt(wp.max(0.0, 1.0 - square)))
    # sin² = off (2 - off), and the point of the disk has the length sqrt(square).
    scale = wp.float32(0.0)
    if square > 0.0:
        scale = wp.sqrt(wp.max(0.0, off * (2.0 - off)) / square)
    return around(wp.normalize(guide.target[low] - position), wp.vec3(d[0] * scale, d[1] * scale, 1.0 - off))


@wp.func
def onward_number(u: wp.float32, part: wp.float32) -> wp.float32:
    """What is left of a number in [0, 1) that has chosen between lobes (below `part`) and the cosine."""
    if u < part:
        return wp.min(u / part, _BELOW_ONE)
    return wp.min((u - part) / (1.0 - part), _BELOW_ONE)


@wp.func
def over_both(by_cosine: wp.float32, by_lobes: wp.float32, part: wp.float32) -> wp.float32:
    """Density by the cosine alone over that of both ways together."""
    if by_cosine > 0.0:
        return by_cosine / ((1.0 - part) * by_cosine + part * by_lobes)
    return 0.0


@wp.kernel
def guided_pdfs(
    guide: CausticGuide,
    offset: wp.int32,
    position: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    pdf_out: wp.array[wp.float32],
    part_out: wp.array[wp.float32],
) -> None:
    """guided_pdf of directions at some places, and CausticGuide.part there; 0 where a region has no lobes."""
    i = offset + wp.tid()
    region = lobes_at(guide, position[i])
    pdf_out[i] = 0.0
    part_out[i] = 0.0
    if region >= 0:
        pdf_out[i] = guided_pdf(guide, region, position[i], direction[i])
        part_out[i] = guide.part[region]
