"""Photons: from surface to surface and through media, until they are absorbed, escape or leave a cell.

A path's credit is simply one; where a cell's part of it ends, its state says why, and the host sends it on.

Which photon is stored where is one rule for all roughnesses (materials.types: the *diffuse* and the *glossy* part of a
surface; a medium counts as diffuse). D is a scattering by a diffuse part or a medium, S one by a glossy part:

* at a surface with a diffuse part, after a D on the way: in the global map (L (S|D)* D (S|D)*); where gather rays read
  it, every photon of the global pass is, straight from the light or not;
* there, after nothing but S: in the caustic map (L S+), by paths of a pass of their own, which ends with the first D;
* there, straight from the light: else nowhere. Direct light is sampled by shadow rays instead (Jensen 1996);
* at every scattering in a medium: in the volume map.

Where light goes straight through a surface (a mask's hole, a medium's boundary, a thin pane), nothing has happened.

A bounce is: `fly` to where its ray ends; `arrive` there, on a surface or in a medium, which scatters some of its flux;
`store` what a map wants; `go_on`, or be absorbed, by Russian roulette.
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.made_for import made_for
from wdpm.kernels.materials.bsdf import make_bsdf
from wdpm.kernels.materials.flights import make_flights
from wdpm.kernels.materials.medium import Media, pass_weight, phase_sample, scatter_weight
from wdpm.kernels.materials.resolve import Materials, medium_beyond
from wdpm.kernels.materials.surface import (
    bump_shading,
    goes_through,
    leave,
    lit_normal,
    make_surface,
    to_local,
    to_world,
    turned,
    unfolded,
)
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.materials.types import FLUX
from wdpm.kernels.photons.deposits import CAUSTIC_MAP, GLOBAL_MAP, NO_MAP, VOLUME_MAP, Deposit, Deposits, store
from wdpm.kernels.photons.flight import (
    BOUNCE_LIMIT,
    BY_DIFFUSE,
    BY_GLOSSY,
    CHOICE,
    DIRECTION,
    ENDED,
    LANDS,
    LOBE,
    ROULETTE,
    TRAVELS,
    WAITS,
    Flight,
    Photon,
    collision,
    load_photon,
    make_into_medium,
    number_1d,
    number_2d,
    optical_free_path,
    store_photon,
    without_hit,
)
from wdpm.kernels.photons.shading_normals import Sides, adjoint_factor, share_of_side, sides_of
from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.kernels.rays.cells import Cells, cell_of, next_cell, next_cell_of
from wdpm.kernels.rays.owners import make_owner_of
from wdpm.kernels.rays.triangle import NO_HIT, Hit
from wdpm.kernels.rays.two_level import Trees, closest_function

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

THIRD = wp.constant(wp.float64(1.0 / 3.0))

GOES_ON = wp.constant(-1)
"""Of a photon whose fate in this cell is not known yet; else ENDED, TRAVELS, LANDS or WAITS."""

# Columns of the energy ledger.
ABSORBED = wp.constant(0)
ESCAPED = wp.constant(1)
CUT = wp.constant(2)


@wp.struct
class TraceScene:
    """What photons need of a scene in one cell."""

    trees: Trees
    surfaces: Surfaces
    materials: Materials
    textures: Textures
    media: Media
    cells: Cells


@wp.struct
class TraceOrders:
    """How photons are followed.

    Attributes:
        landed: 1 if the photons' hits are final and lie in this cell; 0 if their rays are to be intersected here.
        own_cell: number of the cell.
        global_paths: paths from this number on belong to the caustic pass.
        stores_direct: 1 where the global map holds photons straight from the lights too.
        max_depth: longest path in edges, camera edge included; 0 for no limit.
    """

    landed: wp.int32
    own_cell: wp.int32
    global_paths: wp.int64
    stores_direct: wp.int32
    seed: wp.uint32
    max_depth: wp.int32


@wp.struct
class Fates:
    """What became of photons, one an item.

    Attributes:
        status: ENDED, TRAVELS, LANDS or WAITS.
        next_cell: where those that travel or land go.
        energy: what became of the flux of the global pass here, shape [items, 3]: absorbed, escaped, cut off
            [W x paths].
    """

    status: wp.array[wp.int32]
    next_cell: wp.array[wp.int32]
    energy: wp.array2d[wp.float64]


@wp.struct
class Leg:
    """Where a photon's ray ends.

    Attributes:
        status: GOES_ON where it ends in this cell, else what became of the photon.
        destination: the cell that the photon goes to, -1 for none.
        owner: the cell that the hit, or the collision in a medium, lies in.
    """

    status: wp.int32
    destination: wp.int32
    owner: wp.int32
    hit: Hit


@wp.struct
class Arrival:
    """Where a photon's ray ended, and how it would go on.

    Attributes:
        deposit: what a map is to hold of it.
        scattered: flux that goes on, before Russian roulette.
        goes_to: direction in which it does.
        leaves: normal of the side on which it leaves; zero in a medium.
        scatters: 1 where it is scattered, 0 where it goes straight on.
        state, medium: of the path from there on.
    """

    deposit: Deposit
    scattered: wp.vec3
    goes_to: wp.vec3
    leaves: wp.vec3
    scatters: wp.int32
    state: wp.int32
    medium: wp.int32


@wp.func
def mean3(x: wp.vec3) -> wp.float64:
    """Mean of the channels: the energy that the ledger counts."""
    return (wp.float64(x[0]) + wp.float64(x[1]) + wp.float64(x[2])) * THIRD


@functools.cache
def make_fly(instances: bool) -> wp.Function:
    """`fly(scene, own_cell, fresh, photon) -> Leg`, in scenes with or without instances."""
    closest_hit = closest_function(instances)
    owner_of = make_owner_of(instances)

    @wp.func
    def fly(scene: wp.ref[TraceScene], own_cell: wp.int32, fresh: wp.int32, p: Photon) -> Leg:
        """Look for where a photon's ray ends: in this cell, in another, or nowhere.

        Args:
            fresh: 1 where it has been in no cell yet, and begins in this one. Else 0.
        """
        leg = Leg()
        leg.status = GOES_ON
        leg.owner = p.owner
        leg.hit = closest_hit(scene.trees, p.origin, p.direction, p.hit)
        if leg.hit.prim != p.hit.prim:
            leg.owner = owner_of(scene.cells, scene.surfaces, leg.hit)
        end = wp.where(leg.hit.prim >= 0 or leg.hit.t < NO_HIT, leg.owner, -1)
        leg.destination = next_cell_of(scene.cells, p.origin, p.direction, leg.hit.t, end, own_cell, fresh)
        if leg.destination >= 0:
            leg.status = TRAVELS
        elif leg.hit.prim < 0 and leg.hit.t >= NO_HIT:
            leg.status = ENDED
        elif leg.owner != own_cell:
            leg.destination = leg.owner
            leg.status = LANDS
        return leg

    return fly


@functools.cache
def make_arrive_in_medium(features: Features) -> wp.Function:
    """The function `arrive_in_medium` for a set of features."""
    albedo_at = make_flights(features).albedo_at

    @wp.func
    def arrive_in_medium(scene: wp.ref[TraceScene], p: Photon, caustic: bool) -> Arrival:
        """At a collision in a medium: stored, and scattered by the phase function."""
        a = Arrival()
        media = scene.media
        passed = p.hit.t
        if wp.static(features.grids):
            if media.density[p.medium] >= 0:
                passed = optical_free_path(p, scene.media)  # it collided where it had passed just that
        a.deposit.position = collision(p, scene.surfaces.offset_min)
        arriving = wp.cw_mul(p.flux, scatter_weight(media, p.medium, passed))
        arriving = wp.cw_mul(arriving, albedo_at(scene.media, p.medium, a.deposit.position))
        a.deposit.map = NO_MAP
        a.deposit.front = 1
        a.deposit.flux = arriving
        a.deposit.normal = wp.vec3(wp.float32(p.medium), 0.0, 0.0)
        a.deposit.direction = -p.direction
        if not caustic:
            a.deposit.map = VOLUME_MAP
            a.scattered = arriving
        a.goes_to = phase_sample(media.g[p.medium], p.direction, number_2d(p, DIRECTION))
        a.scatters = 1
        a.state = p.state | BY_DIFFUSE
        a.medium = p.medium
        return a

    return arrive_in_medium


@wp.func
def map_of(state: wp.int32, caustic: bool, stores_direct: wp.int32) -> wp.int32:
    """The map that holds a photon at a surface that gathers: the rule of the page's head."""
    if (state & BY_DIFFUSE) != 0 or (stores_direct == 1 and not caustic):
        return GLOBAL_MAP
    if caustic and (state & BY_GLOSSY) != 0:
        return CAUSTIC_MAP
    return NO_MAP


@wp.func
def survival_of(p: Photon, a: Arrival) -> wp.float32:
    """Chance to survive Russian roulette: the largest share of its flux that is scattered. Nothing is played for where
    light goes straight on. A photon too bright for single precision ends: of inf / inf it would survive for ever."""
    if a.scatters == 1:
        share = wp.max(a.scattered) / wp.max(p.flux)
        if not wp.isfinite(share):
            return 0.0
        return wp.min(1.0, share)
    return 1.0


@wp.func
def go_on(p: Photon, a: Arrival, flux: wp.vec3, offset_min: wp.float32) -> Photon:
    """The photon as it leaves from where it arrived.

    Args:
        flux: what goes on of it.
        offset_min: least distance at which rays leave a surface.
    """
    p.flux = flux
    p.origin = a.deposit.position
    if p.hit.prim >= 0:
        p.origin = leave(a.deposit.position, a.leaves, offset_min)
    p.direction = a.goes_to
    p.state = a.state
    p.medium = a.medium
    p.edges += a.scatters
    p.bounce += 1
    return without_hit(p)


@wp.func
def is_cut_off(p: Photon, a: Arrival, max_depth: wp.int32) -> bool:
    """Whether a path may not go on from where it arrived.

    The next landing makes a path of edges + 1 edges from the light, and one more to the camera.
    """
    return (a.scatters == 1 and max_depth > 0 and p.edges + 2 > max_depth) or p.bounce >= BOUNCE_LIMIT


@functools.cache
def make_arrive(features: Features) -> wp.Function:
    """`arrive(scene, orders, photon, caustic) -> Arrival`: where a photon's ray ends in its cell."""
    surface_of_light = make_surface(features).surface_of_light
    arrive_in_medium = make_arrive_in_medium(features)
    optical_length = make_flights(features).optical_length
    bsdf = make_bsdf(features)
    sample_all = bsdf.sample_all
    sample_glossy = bsdf.sample_glossy

    @wp.func
    def arrive_on_surface(scene: wp.ref[TraceScene], orders: TraceOrders, p: Photon, caustic: bool) -> Arrival:
        """At a hit: stored where it gathers, and scattered by one of the surface's parts."""
        a = Arrival()
        to_source = -p.direction  # photons' directions have length 1
        arriving = p.flux
        if wp.static(features.media):
            if p.medium >= 0:
                passed = optical_length(scene.media, p.medium, p.origin, p.direction, p.hit.t)
                if wp.static(features.grids):
                    if scene.media.density[p.medium] >= 0:
                        # It has not collided; where densities are huge, a rounding of t may say that it had.
                        passed = wp.min(passed, optical_free_path(p, scene.media))
                arriving = wp.cw_mul(p.flux, pass_weight(scene.media, p.medium, passed))
        u_choice = wp.float32(0.0)
        if wp.static(features.blend or features.passing):
            u_choice = wp.float32(number_1d(p, CHOICE))
        hit = p.hit
        s = surface_of_light(
            scene.surfaces, scene.materials, scene.textures, hit.prim, hit.u, hit.v, to_source, u_choice
        )
        u_lobe = wp.float32(0.0)
        if wp.static(features.glossy or features.bent):
            u_lobe = wp.float32(number_1d(p, LOBE))
        sides = Sides()
        if wp.static(features.bent):
            if s.bumps2 > 0.0:
                sides = sides_of(s, to_source, u_lobe)
                if sides.turned:
                    s = turned(s)
                u_lobe = sides.left
        a.deposit.map = NO_MAP
        a.deposit.front = s.front
        a.deposit.position = s.position
        a.deposit.flux = arriving
        a.deposit.normal = s.normal
        a.deposit.direction = to_source
        if (scene.materials.gathers[s.material] & (2 - s.front)) != 0:
            a.deposit.map = map_of(p.state, caustic, orders.stores_direct)
        w_from = to_local(s, unfolded(s, to_source))
        u = number_2d(p, DIRECTION)
        sampled = sample_all(s.bsdf, w_from, u_lobe, u, FLUX)
        if wp.static(features.glossy):
            if caustic and sampled.straight == 0:
                sampled = sample_glossy(s.bsdf, w_from, u_lobe, u, FLUX)
        a.goes_to = p.direction
        a.leaves = lit_normal(s)
        a.state = p.state
        a.medium = p.medium
        crosses = sampled.crosses
        if wp.static(features.sheer):
            crosses = goes_through(s, sampled)
        if crosses == 1:
            a.leaves = -s.normal
        if crosses == 1 or s.through == 1:
            a.medium = medium_beyond(scene.materials, s.material, s.front, p.medium)
        a.scattered = wp.cw_mul(arriving, sampled.weight)
        if sampled.straight == 0:
            a.goes_to = to_world(s, sampled.to)
            a.scatters = 1
            a.state = p.state | (BY_GLOSSY - sampled.diffuse)
            factor = adjoint_factor(s, to_source, a.goes_to)
            if wp.dot(a.leaves, a.goes_to) <= 0.0:
                factor = 0.0
            if wp.static(features.bent):
                factor = factor * bump_shading(s, to_source) * share_of_side(s, sides, a.goes_to)
            a.scattered = a.scattered * factor
        return a

    @wp.func
    def arrive(scene: wp.ref[TraceScene], orders: TraceOrders, p: Photon, caustic: bool) -> Arrival:
        if wp.static(features.media):
            if p.hit.prim < 0:
                return arrive_in_medium(scene, p, caustic)
        return arrive_on_surface(scene, orders, p, caustic)

    return arrive


@functools.cache
def make_trace_photons(features: Features) -> wp.Kernel:
    """The kernel that follows photons."""
    arrive = make_arrive(features)
    into_medium = make_into_medium(features)
    fly = make_fly(features.instances)

    @made_for(features)
    def trace_photons(
        scene: TraceScene,
        orders: TraceOrders,
        flight: Flight,
        chunk: wp.int32,
        offset: wp.int32,
        deposits_out: Deposits,
        fates_out: Fates,
    ) -> None:
        """Follow photons for as long as they stay in this cell. `flight` is updated in place.

        Args:
            chunk: the region of `deposits_out` that this launch fills.
        """
        i = offset + wp.tid()
        p = load_photon(flight, i, orders.seed)
        caustic = p.path >= orders.global_paths
        final = orders.landed == 1
        status = wp.int32(GOES_ON)
        destination = wp.int32(-1)
        fresh = wp.int32(0)
        absorbed = wp.float64(0.0)
        escaped = wp.float64(0.0)
        cut = wp.float64(0.0)

        while status == GOES_ON:
            if not final:
                leg = fly(scene, orders.own_cell, fresh, p)
                p.hit = leg.hit
                p.owner = leg.owner
                status = leg.status
                destination = leg.destination
                if status == ENDED:
                    escaped += mean3(p.flux)
            if status == GOES_ON:
                final = False
                a = arrive(scene, orders, p, caustic)
                if a.deposit.map != NO_MAP:
                    if not store(deposits_out, chunk, p, a.deposit):
                        status = WAITS
                if status == GOES_ON:
                    if is_cut_off(p, a, orders.max_depth):
                        cut += mean3(p.flux)
                        status = ENDED
                    else:
                        survival = survival_of(p, a)
                        if float(number_1d(p, ROULETTE)) < survival:
                            flux = a.scattered / survival
                            absorbed += mean3(p.flux) - mean3(flux)
                            p = go_on(p, a, flux, scene.surfaces.offset_min)
                            if wp.static(features.media):
                                if p.medium >= 0:
                                    p = into_medium(p, scene.media, scene.cells, scene.surfaces.offset_min)
                            fresh = wp.int32(cell_of(scene.cells, p.origin) == orders.own_cell)
                            if fresh == 0:
                                destination = next_cell(scene.cells, p.origin, p.direction, p.hit.t, -1)
                                if destination != orders.own_cell:
                                    status = TRAVELS
                        else:
                            absorbed += mean3(p.flux)
                            status = ENDED

        store_photon(p, i, flight)
        fates_out.status[i] = status
        fates_out.next_cell[i] = destination
        share = wp.float64(1.0)
        if caustic:
            share = wp.float64(0.0)
        fates_out.energy[i, ABSORBED] = absorbed * share
        fates_out.energy[i, ESCAPED] = escaped * share
        fates_out.energy[i, CUT] = cut * share

    return trace_photons
