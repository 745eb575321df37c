"""Photons: from the lights, from surface to surface and through media, until they are absorbed, escape or leave a cell.

A path has one ray in flight at a time, so its credit is simply one; where a cell's part of it ends, its state says
why, and the host sends it on.

Which photon is stored where is one rule for all roughnesses (bsdf_types: the *diffuse* and the *glossy* part of a
surface; a medium counts as diffuse). D is a scattering by a diffuse part or a medium, S one by a glossy part:

* at a surface with a diffuse part, after a D on the way: in the global map (L (S|D)* D (S|D)*); where gather rays read
  it, every photon of the global pass is, straight from the light or not;
* there, after nothing but S: in the caustic map (L S+), by paths of a pass of their own, which ends with the first D;
* there, straight from the light: else nowhere. Direct light is sampled by shadow rays instead (Jensen 1996);
* at every scattering in a medium: in the volume map.

Where light goes straight through a surface (a mask's hole, a medium's boundary, a thin pane), nothing has happened.
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.constants import ADJOINT_BOUND, COLLISION_MARGIN
from wdpm.kernels.features import Features
from wdpm.kernels.lights.lights import Lights, Targets, make_lights
from wdpm.kernels.materials.bsdf import make_bsdf
from wdpm.kernels.materials.medium import Media, free_path, pass_weight, phase_sample, scatter_weight
from wdpm.kernels.materials.resolve import Materials, medium_beyond
from wdpm.kernels.materials.surface import (
    Surface,
    Surfaces,
    bump_shading,
    leave,
    make_surface,
    position_at,
    row_of,
    to_local,
    to_world,
)
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.materials.types import FLUX
from wdpm.kernels.maths.random import (
    PURPOSE_CAUSTIC,
    PURPOSE_EMISSION,
    PURPOSE_SCATTER,
    hash_combine,
    sample_1d,
    sample_2d,
)
from wdpm.kernels.rays.bvh import Bvh, closest_hit
from wdpm.kernels.rays.cells import Cells, cell_of, next_cell
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

# Photon maps.
GLOBAL_MAP = wp.constant(0)
CAUSTIC_MAP = wp.constant(1)
VOLUME_MAP = wp.constant(2)

# State of a path: what scattered it so far.
BY_DIFFUSE = wp.constant(1)
BY_GLOSSY = wp.constant(2)

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

# Dimensions of a bounce's random numbers.
_DIRECTION = wp.constant(0)
_ROULETTE = wp.constant(1)
_LOBE = wp.constant(2)
_CHOICE = wp.constant(3)
_CHANNEL = wp.constant(4)
_FREE_PATH = wp.constant(5)
_DIMENSIONS = wp.constant(6)


@wp.struct
class Flight:
    """Photons in flight, one an item; see cluster.batch.SCHEMAS."""

    path: wp.array[wp.int64]
    bounce: wp.array[wp.int32]
    edges: wp.array[wp.int32]
    state: wp.array[wp.int32]
    medium: wp.array[wp.int32]
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
    edges: wp.array[wp.int32]
    front: wp.array[wp.int32]
    map: wp.array[wp.int32]
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


@wp.func
def mean3(x: wp.vec3) -> wp.float64:
    """Mean of the channels: the energy that the ledger counts."""
    return (wp.float64(x[0]) + wp.float64(x[1]) + wp.float64(x[2])) * THIRD


@wp.func
def adjoint_factor(s: Surface, to_source: wp.vec3, away: wp.vec3) -> wp.float32:
    """What interpolated or bent normals do to a photon's flux (Veach 1997, section 5.3), bounded.

    They make light transport asymmetric, and photons carry the adjoint. Without them the factor is exactly 1. It is 0
    where the two normals do not agree on which side a direction is.
    """
    in_shading = wp.abs(wp.dot(s.n, to_source))
    in_geometric = wp.dot(s.normal, to_source)
    out_shading = wp.abs(wp.dot(s.n, away))
    out_geometric = wp.abs(wp.dot(s.normal, away))
    if in_geometric <= 0.0 or out_shading <= 0.0:
        return wp.float32(0.0)
    return wp.min(in_shading / in_geometric, ADJOINT_BOUND) * wp.min(out_geometric / out_shading, ADJOINT_BOUND)


@wp.func
def reach_of(free: wp.float32, offset_min: wp.float32) -> wp.float32:
    """How far a photon's ray looks for surfaces, given its free path: COLLISION_MARGIN further.

    A collision within a rounding of a wall might be rounded onto it, and the next ray start behind it.
    """
    return wp.min(free + COLLISION_MARGIN * offset_min, NO_HIT)


@wp.func
def collision(origin: wp.vec3, direction: wp.vec3, reach: wp.float32, offset_min: wp.float32) -> wp.vec3:
    """Where a photon collides whose ray met no surface."""
    return origin + direction * wp.max(reach - COLLISION_MARGIN * offset_min, 0.0)


@wp.kernel
def first_cells(cells: Cells, flight: Flight, offset: wp.int32, next_cell_out: wp.array[wp.int32]) -> None:
    """The first cell on the way of each photon that just set out; -1 for one that carries nothing."""
    i = offset + wp.tid()
    next_cell_out[i] = -1
    if wp.max(flight.flux[i]) > 0.0:
        next_cell_out[i] = next_cell(cells, flight.origin[i], flight.direction[i], flight.t[i], -1)


@functools.cache
def make_emit_photons(features: Features) -> wp.Kernel:
    """The kernel that starts photon paths."""
    emit = make_lights(features).emit

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def emit_photons(
        lights: Lights,
        textures: Textures,
        media: Media,
        cells: Cells,
        targets: Targets,
        cumulative: wp.array[wp.float64],
        caustic_cumulative: wp.array[wp.float64],
        first: wp.int64,
        global_paths: wp.int64,
        seed: wp.uint32,
        offset: wp.int32,
        flight_out: Flight,
    ) -> None:
        """Start the paths first + i: those from `global_paths` on belong to the caustic pass and are aimed."""
        i = offset + wp.tid()
        path = first + wp.int64(i)
        number = path
        purpose = PURPOSE_EMISSION
        shares = cumulative
        aimed = wp.int32(0)
        if path >= global_paths:
            number = path - global_paths
            purpose = PURPOSE_CAUSTIC
            shares = caustic_cumulative
            aimed = 1
        index = wp.uint32(number)
        streams = path_streams(seed, purpose, number)
        e = emit(
            lights,
            textures,
            shares,
            targets,
            aimed,
            sample_1d(index, dimension_of(streams, 0)),
            sample_2d(index, dimension_of(streams, 1)),
            sample_2d(index, dimension_of(streams, 2)),
            wp.float32(sample_1d(index, dimension_of(streams, 3))),
        )
        flight_out.path[i] = path
        flight_out.bounce[i] = 0
        flight_out.edges[i] = 1
        flight_out.state[i] = 0
        flight_out.medium[i] = e.medium
        flight_out.light[i] = e.light
        flight_out.origin[i] = e.origin
        flight_out.direction[i] = e.direction
        flight_out.flux[i] = e.flux
        flight_out.t[i] = NO_HIT
        flight_out.prim[i] = -1
        flight_out.u[i] = 0.0
        flight_out.v[i] = 0.0
        flight_out.owner[i] = -1
        if wp.static(features.media):
            if e.medium >= 0:
                scatter = path_streams(seed, PURPOSE_SCATTER, path)
                free = free_path(
                    media,
                    e.medium,
                    wp.float32(sample_1d(wp.uint32(path), dimension_of(scatter, _CHANNEL))),
                    wp.float32(sample_1d(wp.uint32(path), dimension_of(scatter, _FREE_PATH))),
                )
                reach = reach_of(free, lights.offset_min)
                flight_out.t[i] = reach
                flight_out.owner[i] = cell_of(cells, collision(e.origin, e.direction, reach, lights.offset_min))

    return emit_photons


@functools.cache
def make_trace_photons(features: Features) -> wp.Kernel:
    """The kernel that follows photons."""
    surface_at = make_surface(features).surface_at
    bsdf = make_bsdf(features)
    sample_all = bsdf.sample_all
    sample_glossy = bsdf.sample_glossy

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def trace_photons(
        bvh: Bvh,
        surfaces: Surfaces,
        materials: Materials,
        textures: Textures,
        media: Media,
        cells: Cells,
        flight: Flight,
        landed: wp.int32,
        own_cell: wp.int32,
        global_paths: wp.int64,
        stores_direct: wp.int32,
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
            global_paths: paths from this number on belong to the caustic pass.
            stores_direct: 1 where the global map holds photons straight from the lights too.
            max_depth: longest path in edges, camera edge included; 0 for no limit.
            energy_out: what became of the flux of the global pass here, float64, shape [items, 3]: absorbed, escaped,
                cut off [W x paths].
        """
        i = offset + wp.tid()
        path = flight.path[i]
        index = wp.uint32(path)
        bounce = flight.bounce[i]
        edges = flight.edges[i]
        state = flight.state[i]
        medium = flight.medium[i]
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
        caustic = path >= global_paths
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
                elif hit.prim < 0 and hit.t >= NO_HIT:
                    escaped += mean3(flux)
                    status = ENDED
                elif owner != own_cell:
                    destination = owner
                    status = LANDS
            if status < 0:
                final = False
                to_source = -direction  # photons' directions have length 1
                first = _DIMENSIONS * bounce
                arriving = flux
                position = collision(origin, direction, hit.t, surfaces.offset_min)
                normal = wp.vec3(0.0)
                goes_to = direction
                leaves = wp.vec3(0.0)  # normal of the side on which it leaves; zero in a medium
                scattered = wp.vec3(0.0)
                scatters = wp.bool(False)  # other than straight on
                stores_in = wp.int32(-1)
                front = wp.int32(1)
                new_state = state
                new_medium = medium
                if wp.static(features.media):
                    if hit.prim < 0:
                        arriving = wp.cw_mul(flux, scatter_weight(media, medium, hit.t))
                        normal = wp.vec3(wp.float32(medium), 0.0, 0.0)
                        arriving = wp.cw_mul(arriving, media.albedo[medium])
                        if not caustic:
                            stores_in = VOLUME_MAP
                            scattered = arriving
                        goes_to = phase_sample(
                            media.g[medium], direction, sample_2d(index, dimension_of(streams, first + _DIRECTION))
                        )
                        scatters = True
                        new_state = state | BY_DIFFUSE
                    elif medium >= 0:
                        arriving = wp.cw_mul(flux, pass_weight(media, medium, hit.t))
                if hit.prim >= 0:
                    u_choice = wp.float32(0.0)
                    if wp.static(features.blend or features.passing):
                        u_choice = wp.float32(sample_1d(index, dimension_of(streams, first + _CHOICE)))
                    s = surface_at(surfaces, materials, textures, hit.prim, hit.u, hit.v, to_source, u_choice)
                    position = s.position
                    normal = s.normal
                    front = s.front
                    gathers = (materials.gathers[s.material] & (2 - s.front)) != 0
                    if gathers:
                        if (state & BY_DIFFUSE) != 0 or (stores_direct == 1 and not caustic):
                            stores_in = GLOBAL_MAP
                        elif caustic and (state & BY_GLOSSY) != 0:
                            stores_in = CAUSTIC_MAP
                    w_from = to_local(s, to_source)
                    u_lobe = wp.float32(0.0)
                    if wp.static(features.glossy):
                        u_lobe = wp.float32(sample_1d(index, dimension_of(streams, first + _LOBE)))
                    u = sample_2d(index, dimension_of(streams, first + _DIRECTION))
                    sampled = sample_all(s.bsdf, w_from, u_lobe, u, FLUX)
                    if wp.static(features.glossy):
                        if caustic and sampled.straight == 0:
                            sampled = sample_glossy(s.bsdf, w_from, u_lobe, u, FLUX)
                    leaves = s.normal
                    if sampled.crosses == 1:
                        leaves = -s.normal
                        new_medium = medium_beyond(materials, s.material, s.front, medium)
                    scattered = wp.cw_mul(arriving, sampled.weight)
                    if sampled.straight == 0:
                        goes_to = to_world(s, sampled.to)
                        scatters = True
                        new_state = state | (BY_GLOSSY - sampled.diffuse)
                        factor = adjoint_factor(s, to_source, goes_to)
                        if wp.dot(leaves, goes_to) <= 0.0:
                            factor = 0.0
                        if wp.static(features.bent):
                            factor = factor * bump_shading(s, to_source)
                        scattered = scattered * factor

                if stores_in >= 0:
                    slot = wp.atomic_add(deposits_out.count, chunk, 1)
                    if slot >= deposits_out.capacity:
                        status = WAITS
                    else:
                        slot += chunk * deposits_out.capacity
                        deposits_out.id[slot] = (path << wp.int64(BOUNCE_BITS)) | wp.int64(bounce)
                        deposits_out.edges[slot] = edges
                        deposits_out.front[slot] = front
                        deposits_out.map[slot] = stores_in
                        deposits_out.light[slot] = flight.light[i]
                        deposits_out.position[slot] = position
                        deposits_out.flux[slot] = arriving
                        deposits_out.normal[slot] = normal
                        deposits_out.direction[slot] = to_source
                if status < 0:
                    # The next landing makes a path of edges + 1 edges from the light, and one more to the camera.
                    if (scatters and max_depth > 0 and edges + 2 > max_depth) or bounce >= BOUNCE_LIMIT:
                        cut += mean3(flux)
                        status = ENDED
                    else:
                        survival = wp.float32(1.0)
                        if scatters:
                            survival = wp.min(1.0, wp.max(scattered) / wp.max(flux))
                        roulette = float(sample_1d(index, dimension_of(streams, first + _ROULETTE)))
                        if roulette < survival:
                            scattered = scattered / survival
                            absorbed += mean3(flux) - mean3(scattered)
                            flux = scattered
                            origin = position
                            if hit.prim >= 0:
                                origin = leave(position, leaves, surfaces.offset_min)
                            direction = goes_to
                            state = new_state
                            medium = new_medium
                            edges += wp.int32(scatters)
                            bounce += 1
                            hit.t = NO_HIT
                            hit.prim = -1
                            owner = -1
                            if wp.static(features.media):
                                if medium >= 0:
                                    next_first = _DIMENSIONS * bounce
                                    free = free_path(
                                        media,
                                        medium,
                                        wp.float32(sample_1d(index, dimension_of(streams, next_first + _CHANNEL))),
                                        wp.float32(sample_1d(index, dimension_of(streams, next_first + _FREE_PATH))),
                                    )
                                    hit.t = reach_of(free, surfaces.offset_min)
                                    owner = cell_of(cells, collision(origin, direction, hit.t, surfaces.offset_min))
                            destination = next_cell(cells, origin, direction, hit.t, -1)
                            if destination != own_cell:
                                status = TRAVELS
                        else:
                            absorbed += mean3(flux)
                            status = ENDED

        flight.bounce[i] = bounce
        flight.edges[i] = edges
        flight.state[i] = state
        flight.medium[i] = medium
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
        share = wp.float64(1.0)
        if caustic:
            share = wp.float64(0.0)
        energy_out[i, ABSORBED] = absorbed * share
        energy_out[i, ESCAPED] = escaped * share
        energy_out[i, CUT] = cut * share

    return trace_photons
