"""Photons in flight: what is known of one between launches, its random numbers, and what may become of it in a cell.

A path has one ray in flight at a time. Between launches, and over the wire, photons are columns (`Flight`); a thread
takes one of them up as a `Photon`, follows it and puts it back.
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.columns import FromFields, columns_of, item_of, loader, storer
from wdpm.kernels.constants import COLLISION_MARGIN
from wdpm.kernels.features import Features
from wdpm.kernels.materials.flights import make_flights
from wdpm.kernels.materials.medium import Media, free_path
from wdpm.kernels.maths.random import PURPOSE_SCATTER, hash_combine, sample_1d, sample_2d
from wdpm.kernels.ray_fields import PHOTON
from wdpm.kernels.rays.cells import Cells, cell_of
from wdpm.kernels.rays.triangle import NO_HIT, Hit

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# What became of a photon path in a cell.
ENDED = wp.constant(0)
TRAVELS = wp.constant(1)
"""Its ray goes on into another cell."""
LANDS = wp.constant(2)
"""Its hit is final, and lies in another cell."""
WAITS = wp.constant(3)
"""No room was left to store it; the same cell takes it up again, as landed."""

# State of a path: what scattered it so far.
BY_DIFFUSE = wp.constant(1)
BY_GLOSSY = wp.constant(2)

BOUNCE_BITS = 16
"""A photon's number is path * 2^16 + bounce."""
BOUNCE_LIMIT = wp.constant((1 << BOUNCE_BITS) - 1)
"""Russian roulette ends a path of albedo 0.999 within 10^4 bounces; this bound only guards closed boxes of albedo 1,
and what it cuts off is counted in the energy ledger."""

# Dimensions of a bounce's random numbers.
DIRECTION = wp.constant(0)
ROULETTE = wp.constant(1)
LOBE = wp.constant(2)
CHOICE = wp.constant(3)
CHANNEL = wp.constant(4)
FREE_PATH = wp.constant(5)
_DIMENSIONS = wp.constant(6)


@columns_of(PHOTON)
class Flight(FromFields):
    """Photons in flight as columns, one an item."""


@item_of({name: field for name, field in PHOTON.items() if name not in ("t", "prim", "u", "v")})
class Photon(FromFields):
    """One of them, in a thread's hands.

    Attributes:
        index: item of its random numbers.
        streams: base of their streams.
        hit: t, prim, u and v.
    """

    index: wp.uint32
    streams: wp.uint32
    hit: Hit


store_photon = storer(Flight, Photon)
_load = loader(Flight, Photon)


@wp.func
def path_streams(seed: wp.uint32, purpose: wp.uint32, path: wp.int64) -> wp.uint32:
    """Base of the streams of a path: those of random.stream_of, for the high half of the path number as the item.

    Numbers of one dimension of all paths form one stream; its items are the low 32 bits of the path number.
    """
    return hash_combine(hash_combine(purpose, seed), wp.uint32(path >> wp.int64(32)))


@wp.func
def dimension_of(streams: wp.uint32, dimension: wp.int32) -> wp.uint32:
    """One dimension's stream of a path."""
    return hash_combine(streams, wp.uint32(dimension))


@wp.func
def _with_numbers(p: Photon, seed: wp.uint32) -> Photon:
    """A photon and its random numbers for scatterings."""
    p.index = wp.uint32(p.path)
    p.streams = path_streams(seed, PURPOSE_SCATTER, p.path)
    return p


@wp.func
def new_photon(path: wp.int64, seed: wp.uint32) -> Photon:
    """A path before its first edge."""
    p = Photon()
    p.path = path
    return _with_numbers(p, seed)


@wp.func
def number_1d(p: Photon, dimension: wp.int32) -> wp.float64:
    """A random number of the photon's next bounce, in [0, 1)."""
    return sample_1d(p.index, dimension_of(p.streams, _DIMENSIONS * p.bounce + dimension))


@wp.func
def number_2d(p: Photon, dimension: wp.int32) -> wp.vec2:
    """Two random numbers of the photon's next bounce, in [0, 1]²."""
    return sample_2d(p.index, dimension_of(p.streams, _DIMENSIONS * p.bounce + dimension))


@wp.func
def load_photon(flight: wp.ref[Flight], i: wp.int32, seed: wp.uint32) -> Photon:
    """Take a photon up."""
    return _with_numbers(_load(flight, i), seed)


@wp.func
def reach_of(free: wp.float32, offset_min: wp.float32) -> wp.float32:
    """How far a photon's ray looks for surfaces, given its free path: COLLISION_MARGIN further.

    A collision within a rounding of a wall might be rounded onto it, and the next ray start behind it.
    """
    return wp.min(free + COLLISION_MARGIN * offset_min, NO_HIT)


@wp.func
def collision(p: Photon, offset_min: wp.float32) -> wp.vec3:
    """Where a photon collides whose ray met no surface."""
    return p.origin + p.direction * wp.max(p.hit.t - COLLISION_MARGIN * offset_min, 0.0)


@wp.func
def without_hit(p: Photon) -> Photon:
    """The photon as it sets out through empty space: its ray has met nothing."""
    p.hit.t = NO_HIT
    p.hit.prim = -1
    p.owner = -1
    return p


@wp.func
def optical_free_path(p: Photon, media: wp.ref[Media]) -> wp.float32:
    """The free path of a photon from where it set out last, as an optical length: a function of its numbers alone."""
    return free_path(media, p.medium, wp.float32(number_1d(p, CHANNEL)), wp.float32(number_1d(p, FREE_PATH)))


@functools.cache
def make_into_medium(features: Features) -> wp.Function:
    """The function `into_medium` for a set of features."""
    distance_at = make_flights(features).distance_at

    @wp.func
    def into_medium(p: Photon, media: wp.ref[Media], cells: wp.ref[Cells], offset_min: wp.float32) -> Photon:
        """The photon as it sets out through its medium: it will collide at the end of its free path, if nothing is
        before.

        Args:
            offset_min: least distance at which rays leave a surface.
        """
        free = distance_at(media, p.medium, p.origin, p.direction, optical_free_path(p, media))
        p.hit.t = reach_of(free, offset_min)
        p.owner = cell_of(cells, collision(p, offset_min))
        return p

    return into_medium
