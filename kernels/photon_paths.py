"""Photons: from the lights, from surface to surface, until they are absorbed, escape or leave the cell.

A path has one ray in flight at a time, so its credit is simply one; where a cell's part of it ends, its state says
why, and the host sends it on. A photon is stored at every surface it meets but the first: light straight from a lamp is
sampled by shadow rays instead (Jensen 1996).
"""

from __future__ import annotations

import warp as wp

from wdpm.kernels.bvh import Bvh, closest_hit
from wdpm.kernels.cells import Cells, cell_of, next_cell
from wdpm.kernels.constants import ADJOINT_BOUND
from wdpm.kernels.lights import LightTable, cosine_hemisphere, emit
from wdpm.kernels.random import (
    PURPOSE_EMISSION,
    PURPOSE_SCATTER,
    hash_combine,
    sample_1d,
    sample_2d,
)
from wdpm.kernels.surface import Surface, Surfaces, leave, position_at, row_of, surface_at
from wdpm.kernels.triangle import NO_HIT, Hit

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# What became of a photon path in a cell.
ENDED = wp.constant(0)
TRAVELS = wp.constant(1)
"""Its ray goes on into another cell."""
LANDS = wp.constant(2)
"""Its hit is final, and lies in another cell."""
WAITS = wp.constant(3)
"""No room was left to store it; the same cell takes it up again, as landed."""

BOUNCE_BITS = 16
"""A photon's number is path * 2^16 + bounce."""
BOUNCE_LIMIT = wp.constant((1 << BOUNCE_BITS) - 1)
"""Russian roulette ends a path of albedo 0.999 within 10^4 bounces; this bound only guards closed boxes of albedo 1,
and what it cuts off is counted in the energy ledger."""

THIRD = wp.constant(wp.float64(1.0 / 3.0))

# Columns of the energy ledger.
ABSORBED = wp.constant(0)
ESCAPED = wp.constant(1)
CUT = wp.constant(2)


@wp.struct
class Flight:
    """Photons in flight, one an item; see cluster.batch.SCHEMAS."""

    path: wp.array[wp.int64]
    bounce: wp.array[wp.int32]
    light: wp.array[wp.int32]
    origin: wp.array[wp.vec3]
    direction: wp.array[wp.vec3]
    flux: wp.array[wp.vec3]
    t: wp.array[wp.float32]
    prim: wp.array[wp.int32]
    u: wp.array[wp.float32]
    v: wp.array[wp.float32]
    owner: wp.array[wp.int32]


@wp.struct
class Deposits:
    """Room for stored photons: a region of `capacity` for each chunk, and how many it was asked to take."""

    capacity: wp.int32
    count: wp.array[wp.int32]
    id: wp.array[wp.int64]
    light: wp.array[wp.int32]
    position: wp.array[wp.vec3]
    flux: wp.array[wp.vec3]
    normal: wp.array[wp.vec3]
    direction: wp.array[wp.vec3]


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


@wp.kernel
def emit_photons(lights: LightTable, first: wp.int64, seed: wp.uint32, offset: wp.int32, flight_out: Flight) -> None:
    """Start the paths first + i."""
    i = offset + wp.tid()
    path = first + wp.int64(i)
    index = wp.uint32(path)
    streams = path_streams(seed, PURPOSE_EMISSION, path)
    e = emit(
        lights,
        sample_1d(index, dimension_of(streams, 0)),
        sample_2d(index, dimension_of(streams, 1)),
        sample_2d(index, dimension_of(streams, 2)),
    )
    flight_out.path[i] = path
    flight_out.bounce[i] = 0
    flight_out.light[i] = e.light
    flight_out.origin[i] = e.origin
    flight_out.direction[i] = e.direction
    flight_out.flux[i] = e.flux
    flight_out.t[i] = NO_HIT
    flight_out.prim[i] = -1
    flight_out.u[i] = 0.0
    flight_out.v[i] = 0.0
    flight_out.owner[i] = -1


@wp.func
def mean3(x: wp.vec3) -> wp.float64:
    """Mean of the channels: the energy that the ledger counts."""
    return (wp.float64(x[0]) + wp.float64(x[1]) + wp.float64(x[2])) * THIRD


@wp.func
def scatter_weight(surface: Surface, to_source: wp.vec3, away: wp.vec3) -> wp.vec3:
    """Share of the flux that goes on, for a direction `away` sampled by the cosine about the shading normal.

    Interpolated normals make light transport asymmetric; photons carry the adjoint (Veach 1997, section 5.3).
    Without them the factor is exactly 1.
    """
    in_shading = wp.dot(surface.shading_normal, to_source)
    out_geometric = wp.dot(surface.normal, away)
    if in_shading <= 0.0 or out_geometric <= 0.0:
        return wp.vec3(0.0)
    in_geometric = wp.dot(surface.normal, to_source)
    out_shading = wp.dot(surface.shading_normal, away)
    if in_geometric <= 0.0 or out_shading <= 0.0:
        return wp.vec3(0.0)
    return surface.albedo * (
        wp.min(in_shading / in_geometric, ADJOINT_BOUND) * wp.min(out_geometric / out_shading, ADJOINT_BOUND)
    )


@wp.kernel
def trace_photons(
    bvh: Bvh,
    surfaces: Surfaces,
    cells: Cells,
    flight: Flight,
    landed: wp.int32,
    own_cell: wp.int32,
    seed: wp.uint32,
    max_depth: wp.int32,
    chunk: wp.int32,
    offset: wp.int32,
    deposits_out: Deposits,
    status_out: wp.array[wp.int32],
    next_cell_out: wp.array[wp.int32],
    energy_out: wp.array2d[wp.float64],
) -> None:
    """Follow photons for as long as they stay in this cell. `flight` is updated in place.

    Args:
        landed: 1 if the photons' hits are final and lie in this cell; 0 if their rays are to be intersected here.
        max_depth: longest path in edges, camera edge included; 0 for no limit.
        energy_out: what became of the flux here, float64, shape [items, 3]: absorbed, escaped, cut off [W x paths].
    """
    i = offset + wp.tid()
    path = flight.path[i]
    index = wp.uint32(path)
    bounce = flight.bounce[i]
    origin = flight.origin[i]
    direction = flight.direction[i]
    flux = flight.flux[i]
    owner = flight.owner[i]
    hit = Hit()
    hit.t = flight.t[i]
    hit.prim = flight.prim[i]
    hit.u = flight.u[i]
    hit.v = flight.v[i]
    streams = path_streams(seed, PURPOSE_SCATTER, path)
    final = landed == 1
    status = wp.int32(-1)
    destination = wp.int32(-1)
    absorbed = wp.float64(0.0)
    escaped = wp.float64(0.0)
    cut = wp.float64(0.0)

    while status < 0:
        if not final:
            found = closest_hit(bvh, origin, direction, hit)
            if found.prim != hit.prim:
                row = row_of(surfaces, found.prim)
                owner = cell_of(cells, position_at(surfaces, row, found.u, found.v))
            hit = found
            destination = next_cell(cells, origin, direction, hit.t, own_cell)
            if destination >= 0:
                status = TRAVELS
            elif hit.prim < 0:
                escaped += mean3(flux)
                status = ENDED
            elif owner != own_cell:
                destination = owner
                status = LANDS
        if status < 0:
            final = False
            to_source = -direction  # photons' directions have length 1
            s = surface_at(surfaces, hit.prim, hit.u, hit.v, to_source)
            if s.reflects and bounce >= 1:
                slot = wp.atomic_add(deposits_out.count, chunk, 1)
                if slot >= deposits_out.capacity:
                    status = WAITS
                else:
                    slot += chunk * deposits_out.capacity
                    deposits_out.id[slot] = (path << wp.int64(BOUNCE_BITS)) | wp.int64(bounce)
                    deposits_out.light[slot] = flight.light[i]
                    deposits_out.position[slot] = s.position
                    deposits_out.flux[slot] = flux
                    deposits_out.normal[slot] = s.normal
                    deposits_out.direction[slot] = to_source
            if status < 0:
                # The next landing makes a path of bounce + 3 edges: bounce + 2 from the light, one to the camera.
                if not s.reflects:
                    absorbed += mean3(flux)
                    status = ENDED
                elif (max_depth > 0 and bounce + 3 > max_depth) or bounce >= BOUNCE_LIMIT:
                    cut += mean3(flux)
                    status = ENDED
                else:
                    away = cosine_hemisphere(s.shading_normal, sample_2d(index, dimension_of(streams, 2 * bounce)))
                    scattered = wp.cw_mul(flux, scatter_weight(s, to_source, away))
                    survival = wp.min(1.0, wp.max(scattered) / wp.max(flux))
                    roulette = float(sample_1d(index, dimension_of(streams, 2 * bounce + 1)))
                    if roulette < survival:
                        scattered = scattered / survival
                        absorbed += mean3(flux) - mean3(scattered)
                        flux = scattered
                        origin = leave(s.position, s.normal, surfaces.offset_min)
                        direction = away
                        bounce += 1
                        hit.t = NO_HIT
                        hit.prim = -1
                        owner = -1
                        destination = next_cell(cells, origin, direction, NO_HIT, -1)
                        if destination != own_cell:
                            status = TRAVELS
                    else:
                        absorbed += mean3(flux)
                        status = ENDED

    flight.bounce[i] = bounce
    flight.origin[i] = origin
    flight.direction[i] = direction
    flight.flux[i] = flux
    flight.t[i] = hit.t
    flight.prim[i] = hit.prim
    flight.u[i] = hit.u
    flight.v[i] = hit.v
    flight.owner[i] = owner
    status_out[i] = status
    next_cell_out[i] = destination
    energy_out[i, ABSORBED] = absorbed
    energy_out[i, ESCAPED] = escaped
    energy_out[i, CUT] = cut


@wp.kernel
def first_cells(cells: Cells, flight: Flight, offset: wp.int32, next_cell_out: wp.array[wp.int32]) -> None:
    """The first cell on the way of each photon that just set out."""
    i = offset + wp.tid()
    next_cell_out[i] = next_cell(cells, flight.origin[i], flight.direction[i], NO_HIT, -1)
