"""The pilot of a guide: places that camera paths come to, and what of the lights each of them sees.

Surfaces are taken to be diffuse, but for those that let light through: there paths and rays go straight on. So places
are about those at which a render asks for direct light, and no material has to be computed.
"""

from __future__ import annotations

import warp as wp

from wdpm.kernels.lights.balls import way_to_ball
from wdpm.kernels.lights.choice import ElementChoice, choose_below
from wdpm.kernels.lights.elements import Lights, point_of_triangle, probability_of
from wdpm.kernels.lights.environment import Environment, EnvironmentSample, patch_pdf, sample_environment
from wdpm.kernels.lights.guide import Guide, region_of, sample_guided, tile_of
from wdpm.kernels.lights.tree import DISTANT, LeafChoice, chance_of_start, walk_down
from wdpm.kernels.materials.bsdf import cosine_direction
from wdpm.kernels.materials.surface import leave
from wdpm.kernels.maths.directions import around
from wdpm.kernels.maths.random import PURPOSE_GUIDE, rounded_down, sample_2d, sample_2d_fine, stream_of
from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.kernels.rays.instanced_triangles import front_of_all, position_at_all, row_of_all, table_row_of_all
from wdpm.kernels.rays.triangle import no_hit
from wdpm.kernels.rays.two_level import Trees, any_of_all, closest_of_all

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MOST_PASSAGES = wp.constant(16)
"""Surfaces that a ray of the pilot goes through, at most, before it counts as blocked."""

ENVIRONMENT_STREAM = wp.constant(64)
"""Dimension of the numbers of directions to the environment; below it are the bounces of paths."""

START_STREAM = wp.constant(65)
"""And of points on lights."""


@wp.struct
class PilotScene:
    """What the pilot's rays meet.

    Attributes:
        far_away: a distance beyond all surfaces.
        through: 1 for materials that camera rays go through, 2 for those that shadow rays go through as well.
        passing: 1 where there are any of the latter.
    """

    trees: Trees
    surfaces: Surfaces
    through: wp.array[wp.int32]
    passing: wp.int32
    far_away: wp.float32


@wp.kernel
def walk_on(
    scene: PilotScene,
    bounce: wp.int32,
    seed: wp.uint32,
    offset: wp.int32,
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    position_out: wp.array[wp.vec3],
    normal_out: wp.array[wp.vec3],
) -> None:
    """Take rays to the next place, and on from there.

    Args:
        origin, direction: of the rays; in place.
        normal_out: unit geometric normal on the side where a ray arrives; zero where it comes to no place.
    """
    i = offset + wp.tid()
    position_out[i] = wp.vec3(0.0)
    normal_out[i] = wp.vec3(0.0)
    way = wp.normalize(direction[i])
    hit = closest_of_all(scene.trees, origin[i], way, no_hit())
    if hit.prim < 0:
        direction[i] = wp.vec3(0.0, 0.0, 0.0)
        return
    row = row_of_all(scene.surfaces, hit.prim)
    place = position_at_all(scene.surfaces, row, hit.u, hit.v)
    normal = front_of_all(scene.surfaces, row)
    if wp.dot(normal, way) > 0.0:
        normal = -normal
    if scene.through[scene.surfaces.material[table_row_of_all(row)]] > 0:
        origin[i] = leave(place, -normal, scene.surfaces.offset_min)
        return
    position_out[i] = place
    normal_out[i] = normal
    origin[i] = leave(place, normal, scene.surfaces.offset_min)
    u = sample_2d(wp.uint32(i), stream_of(seed, PURPOSE_GUIDE, wp.uint32(0), bounce))
    direction[i] = around(normal, cosine_direction(u))


@wp.func
def _arrives(scene: wp.ref[PilotScene], start: wp.vec3, end: wp.vec3) -> wp.bool:
    """Whether light gets from one place to another: whether all between them lets shadow rays through."""
    if scene.passing == 0:
        return not any_of_all(scene.trees, start, end - start, 1.0)
    origin = start
    for _ in range(MOST_PASSAGES):
        direction = end - origin
        hit = closest_of_all(scene.trees, origin, direction, no_hit())
        if hit.prim < 0 or hit.t >= 1.0:
            return True
        row = row_of_all(scene.surfaces, hit.prim)
        if scene.through[scene.surfaces.material[table_row_of_all(row)]] < 2:
            return False
        normal = front_of_all(scene.surfaces, row)
        if wp.dot(normal, direction) < 0.0:
            normal = -normal
        origin = leave(position_at_all(scene.surfaces, row, hit.u, hit.v), normal, scene.surfaces.offset_min)
    return False


@wp.kernel
def look_at_environment(
    scene: PilotScene,
    environment: Environment,
    guide: Guide,
    position: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    first: wp.int32,
    rays: wp.int32,
    seed: wp.uint32,
    offset: wp.int32,
    tile_out: wp.array[wp.int32],
    cosine_out: wp.array[wp.float32],
) -> None:
    """Some directions to the environment from each place.

    Args:
        guide: how directions are chosen; in proportion to radiance alone where it has no regions.
        rays: from each place, numbers `first` to first + rays - 1 of it; ray j of place i is item i * rays + j.
        cosine_out: between direction and normal; 0 where nothing arrives.
    """
    i = offset + wp.tid()
    place = i // rays
    u = sample_2d(wp.uint32(first + i % rays), stream_of(seed, PURPOSE_GUIDE, wp.uint32(place), ENVIRONMENT_STREAM))
    region = region_of(guide, position[place])
    found = EnvironmentSample()
    if region >= 0:
        found = sample_guided(environment, guide, region, u)
    else:
        found = sample_environment(environment, u)
    tile_out[i] = 0
    cosine_out[i] = 0.0
    if found.pdf > 0.0:
        patch = patch_pdf(environment, found.direction)
        tile_out[i] = tile_of(guide, patch.row, patch.column)
        cosine = wp.dot(normal[place], found.direction)
        if cosine > 0.0:
            start = leave(position[place], normal[place], scene.surfaces.offset_min)
            if _arrives(scene, start, start + found.direction * scene.far_away):
                cosine_out[i] = cosine


@wp.func
def _end_on_light(lights: wp.ref[Lights], chosen: ElementChoice, position: wp.vec3) -> wp.vec3:
    """Where a shadow ray to a point of a light ends; at the place itself where that is not lit by it."""
    element = chosen.element
    if chosen.ball > 0.0:
        if chosen.probability > 0.0:
            way = way_to_ball(lights.tree.nodes[chosen.leaf], chosen.ball, position, chosen.u)
            return leave(way.end, way.normal, lights.offset_min)
        return position
    if element < lights.triangles:
        end = leave(point_of_triangle(lights, element, chosen.weights), lights.normal[element], lights.offset_min)
        if wp.dot(lights.normal[element], position - end) > 0.0:
            return end
        return position
    if element < lights.first_distant:
        return lights.deltas.position[element - lights.triangles]
    if element < lights.first_environment:
        return position - lights.deltas.z[element - lights.triangles] * lights.far_away
    return position + sample_environment(lights.environment, chosen.u).direction * lights.far_away


@wp.kernel
def look_at_lights(
    scene: PilotScene,
    lights: Lights,
    position: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    rays: wp.int32,
    seed: wp.uint32,
    offset: wp.int32,
    cosine_out: wp.array[wp.float32],
    chance_out: wp.array[wp.float32],
) -> None:
    """Some rays from each place to each of what walks to a light may start with, and to each light infinitely far away.

    Args:
        rays: from each place to each; ray j of place i to choice c is item (i * rays + j) * choices + c. Heads of the
            light tree come first.
        chance_out: probability of the choice at the place without a guide.
    """
    i = offset + wp.tid()
    heads = lights.tree.head_count
    choices = heads + lights.count - lights.first_distant
    choice = i % choices
    place = i // choices // rays
    here = position[place]
    leaf = LeafChoice()
    leaf.probability = 1.0
    u = sample_2d_fine(
        wp.uint32(i // choices % rays), stream_of(seed, PURPOSE_GUIDE, wp.uint32(place), START_STREAM + choice)
    )
    chosen = ElementChoice()
    if choice < heads:
        leaf.node = lights.tree.heads[choice]
        leaf.u = u[0]
        chance_out[i] = chance_of_start(lights.tree, lights.guide, -1, leaf.node, here)
        chosen = choose_below(lights, -1, walk_down(lights.tree, leaf, here), here, u[1])
    else:
        distant = choice - heads
        chance_out[i] = chance_of_start(lights.tree, lights.guide, -1, DISTANT, here)
        chance_out[i] = chance_out[i] * probability_of(lights.distant, distant)
        chosen.element = lights.first_distant + distant
        chosen.u = wp.vec2(rounded_down(u[0]), rounded_down(u[1]))
    cosine_out[i] = 0.0
    if chosen.element >= 0 and chance_out[i] > 0.0:
        start = leave(here, normal[place], scene.surfaces.offset_min)
        end = _end_on_light(lights, chosen, here)
        cosine = wp.dot(normal[place], wp.normalize(end - start))
        if wp.length_sq(end - here) > 0.0 and cosine > 0.0:
            if _arrives(scene, start, end):
                cosine_out[i] = cosine
