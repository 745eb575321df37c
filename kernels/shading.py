"""What a camera path's vertex adds to its sample, and where the path goes on.

At every vertex: what the surface emits; direct light by shadow rays, over the surface's diffuse and glossy parts; a
query for photons where there is a diffuse part; and one ray that goes on. What the diffuse part does is the *way*:

* MAP_WAY: it is never traced on. Photons are gathered where the camera path meets it, and the ray goes on by the glossy
  part, so each light path is counted once (photon_paths: which photons are stored).
* PATH_WAY: it is traced on like the glossy part, one of the two at each vertex, and no photon is asked: path tracing.
  Media scatter paths too (medium_vertices).
* GATHER_WAY: it is traced on once. Where such a ray arrives, the photon map is read, which then holds photons of direct
  light too (final gathering, Jensen 1996): `Action` says what each vertex does. Caustics are still gathered where the
  camera path or a short gather ray meets the surface, so what a gather ray finds of lamps, be it by glossy surfaces,
  does not count again.

Light that is found both by shadow rays and by the ray that goes on counts by both, weighted by multiple importance
sampling with the balance heuristic (Veach & Guibas 1995), for each part of a surface by itself.
"""

from __future__ import annotations

import functools
from types import SimpleNamespace

import warp as wp

from wdpm.kernels.bsdf import cosine_direction, make_bsdf
from wdpm.kernels.bsdf_types import BLACK, DIFFUSE, NULL, RADIANCE
from wdpm.kernels.camera import CameraView, make_camera, whole_pixel
from wdpm.kernels.camera_rays import Paths, Rays
from wdpm.kernels.camera_vertices import (
    BEAM_PART,
    BOUNCES,
    CACHED,
    CHOICE,
    EMISSION_PART,
    GATHER_WAY,
    LOBE,
    MAP_WAY,
    PARTS,
    PATH_WAY,
    REACH_PART,
    READ_MAP,
    TRACE_ON,
    Coats,
    Queries,
    Seen,
    Shots,
    Stretches,
    Vertex,
    camera_path,
    carry_on,
    number_1d,
    numbers_2d,
    place_of,
    scattered_again,
)
from wdpm.kernels.cells import Cells, cell_of
from wdpm.kernels.constants import INV_PI, PI, ROULETTE_FROM, ROULETTE_FROM_OF_PATHS, SURVIVAL_MOST
from wdpm.kernels.features import Features
from wdpm.kernels.lights import Lights, make_lights
from wdpm.kernels.materials import Materials, medium_beyond
from wdpm.kernels.medium import Media, transmittance
from wdpm.kernels.medium_vertices import collision_at, flight_of, length_to, make_medium_vertices
from wdpm.kernels.random import PURPOSE_LIGHT, sample_1d, sample_2d, stream_of
from wdpm.kernels.surface import Surface, Surfaces, bump_shading, clearance, leave, make_surface, to_local, to_world
from wdpm.kernels.texture import Textures

__all__ = [
    "BEAM_PART",
    "BOUNCES",
    "CACHED",
    "EMISSION_PART",
    "GATHER_WAY",
    "MAP_WAY",
    "PARTS",
    "PATH_WAY",
    "REACH_PART",
    "READ_MAP",
    "TRACE_ON",
    "Coats",
    "Queries",
    "Seen",
    "Shots",
    "Stretches",
    "make_shading",
]

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_BELOW_ONE = wp.constant(wp.float32(1 - 2.0**-24))


@functools.cache
def make_shading(features: Features) -> SimpleNamespace:
    """Kernels for vertices of camera paths: `shade_camera_hits`, `shade_vertices`, `path_misses`."""
    surface_at = make_surface(features).surface_at
    bsdf = make_bsdf(features)
    eval_diffuse = bsdf.eval_diffuse
    probability_diffuse = bsdf.probability_diffuse
    has_diffuse = bsdf.has_diffuse
    eval_glossy = bsdf.eval_glossy
    pdf_glossy = bsdf.pdf_glossy
    sample_glossy = bsdf.sample_glossy
    light = make_lights(features)
    sample_direct = light.sample_direct
    pdf_triangle = light.pdf_triangle
    emitted_radiance = light.emitted_radiance
    pdf_environment = light.pdf_environment
    environment_radiance = light.environment_radiance
    camera_ray = make_camera(features).camera_ray
    shade_medium = make_medium_vertices(features).shade_medium

    @wp.func
    def camera_vertex(camera: CameraView, rays: Rays, i: wp.int32) -> Vertex:
        """A camera ray as the beginning of a path."""
        ray = camera_ray(camera, rays.pixel[i], rays.sample[i])
        p = Vertex()
        p.slot = rays.slot[i]
        p.pixel = rays.pixel[i]
        p.item = wp.uint32(whole_pixel(camera, p.pixel))
        p.sample = rays.sample[i]
        p.edges = 1
        p.medium = camera.medium
        p.origin = ray.origin
        p.direction = ray.direction
        p.anchor = ray.origin
        p.throughput = wp.vec3(1.0)
        p.t = rays.t[i]
        p.prim = rays.prim[i]
        p.u = rays.u[i]
        p.v = rays.v[i]
        return p

    @wp.func
    def emitted(
        textures: Textures, lights: Lights, p: Vertex, s: Surface, throughput: wp.vec3, light_samples: wp.int32
    ) -> wp.vec3:
        """Radiance of the surface itself, weighted against the shadow rays that might have found it."""
        radiance = wp.vec3(0.0)
        if s.emitter >= 0 and s.front == 1:
            radiance = emitted_radiance(lights, textures, s.emitter, s.uv, s.color)
            if wp.static(features.glossy or features.traced):
                if p.pdf > 0.0:
                    by_light = wp.float32(light_samples) * pdf_triangle(lights, p.prim, p.anchor, s.position, s.normal)
                    radiance = radiance * (p.pdf / (p.pdf + by_light))
        return wp.cw_mul(throughput, radiance)

    @wp.func
    def direct(
        lights: Lights,
        materials: Materials,
        textures: Textures,
        s: Surface,
        p: Vertex,
        throughput: wp.vec3,
        w_from: wp.vec3,
        diffuse_share: wp.float32,
        way: wp.int32,
        offset_min: wp.float32,
        light_samples: wp.int32,
        seed: wp.uint32,
        j: wp.int32,
        row: wp.int32,
        shots_out: Shots,
    ) -> None:
        """One sample of the direct light that a surface reflects: a shadow segment, and what it carries.

        Args:
            diffuse_share: probability that the ray that goes on does so by the diffuse part.
        """
        index = wp.uint32(p.sample) * wp.uint32(light_samples) + wp.uint32(j)
        u_element = sample_1d(index, stream_of(seed, PURPOSE_LIGHT, p.item, 2 * p.bounce))
        u = sample_2d(index, stream_of(seed, PURPOSE_LIGHT, p.item, 2 * p.bounce + 1))
        found = sample_direct(lights, textures, s.position, u_element, u)
        radiance = wp.vec3(0.0)
        side = wp.dot(s.normal, found.direction)
        leaves = s.normal
        if side < 0.0:
            leaves = -s.normal
        if found.pdf > 0.0:
            w_to = to_local(s, found.direction)
            # Both normals must agree on the side that light comes from, or it would leak through walls.
            seen_from = w_from[2]
            reflects = side > 0.0 and w_to[2] * seen_from > 0.0
            crosses = side < 0.0 and w_to[2] * seen_from < 0.0
            scattering = wp.vec3(0.0)
            if reflects:
                scattering = eval_diffuse(s.bsdf, w_from, w_to) * wp.abs(w_to[2])
                if wp.static(features.traced):
                    if way == PATH_WAY and found.delta == 0:
                        by_light = wp.float32(light_samples) * found.pdf
                        by_diffuse = diffuse_share * (wp.max(w_to[2], 0.0) * INV_PI)
                        scattering = scattering * (by_light / (by_light + by_diffuse))
            if wp.static(features.glossy):
                if (reflects or crosses) and (way != GATHER_WAY or p.diffuse == 0):
                    glossy = eval_glossy(s.bsdf, w_from, w_to, RADIANCE)
                    if wp.max(glossy) > 0.0:
                        if found.delta == 0:
                            by_light = wp.float32(light_samples) * found.pdf
                            by_glossy = pdf_glossy(s.bsdf, w_from, w_to)
                            if wp.static(features.traced):
                                by_glossy = (1.0 - diffuse_share) * by_glossy
                            glossy = glossy * (by_light / (by_light + by_glossy))
                        scattering = scattering + glossy
            if wp.static(features.bent):
                scattering = scattering * bump_shading(s, found.direction)
            radiance = wp.cw_mul(throughput, wp.cw_mul(scattering, found.radiance)) / found.pdf
        if p.bounce > 0:
            radiance = radiance / wp.float32(light_samples)
        origin = leave(s.position, leaves, offset_min)
        shots_out.slot[row] = p.slot
        shots_out.place[row] = place_of(p.bounce, p.diffuse, light_samples, j)
        shots_out.origin[row] = origin
        shots_out.direction[row] = found.end - origin
        shots_out.radiance[row] = radiance
        if wp.static(features.media):
            shots_out.medium[row] = p.medium
            if side < 0.0:
                shots_out.medium[row] = medium_beyond(materials, s.material, s.front, p.medium)

    @wp.func
    def go_on(
        materials: Materials,
        s: Surface,
        p: Vertex,
        throughput: wp.vec3,
        w_from: wp.vec3,
        diffuse_share: wp.float32,
        way: wp.int32,
        offset_min: wp.float32,
        max_depth: wp.int32,
        seed: wp.uint32,
        i: wp.int32,
        paths_out: Paths,
    ) -> None:
        """The ray that goes on by one part, or straight through; a throughput of zero where none does."""
        carries = wp.vec3(0.0)
        direction = p.direction
        leaves = s.normal
        pdf = p.pdf
        anchor = p.anchor
        edges = p.edges
        diffuse = p.diffuse
        medium = p.medium
        straight = wp.int32(0)
        u_lobe = wp.float32(0.0)
        if wp.static(features.glossy):
            u_lobe = number_1d(seed, p, LOBE)
        if wp.static(features.passing):
            if s.bsdf.kind == NULL:
                straight = 1
                carries = throughput
                leaves = -s.normal
                medium = medium_beyond(materials, s.material, s.front, medium)
        by_diffuse = wp.bool(False)
        if wp.static(features.traced):
            by_diffuse = straight == 0 and diffuse_share > 0.0 and (u_lobe < diffuse_share or diffuse_share == 1.0)
            if by_diffuse:
                w_to = cosine_direction(numbers_2d(seed, p))
                direction = to_world(s, w_to)
                pdf = diffuse_share * (w_to[2] * INV_PI)
                anchor = s.position
                edges += 1
                diffuse = wp.where(diffuse == 0, 1, scattered_again(diffuse))
                if wp.dot(leaves, direction) > 0.0 and (max_depth == 0 or edges <= max_depth):
                    carries = wp.cw_mul(throughput, eval_diffuse(s.bsdf, w_from, w_to) * (PI / diffuse_share))
                    if wp.static(features.bent):
                        carries = carries * bump_shading(s, direction)
        if wp.static(features.glossy):
            if straight == 0 and not by_diffuse and s.bsdf.kind != DIFFUSE and s.bsdf.kind != BLACK:
                u = numbers_2d(seed, p)
                rest = wp.float32(1.0)
                if wp.static(features.traced):
                    if diffuse_share > 0.0:
                        rest = 1.0 - diffuse_share
                        u_lobe = wp.min((u_lobe - diffuse_share) / rest, _BELOW_ONE)
                sampled = sample_glossy(s.bsdf, w_from, u_lobe, u, RADIANCE)
                if sampled.crosses == 1:
                    leaves = -s.normal
                    medium = medium_beyond(materials, s.material, s.front, medium)
                if sampled.straight == 1:
                    carries = wp.cw_mul(throughput, sampled.weight) / rest
                else:
                    direction = to_world(s, sampled.to)
                    pdf = rest * sampled.pdf
                    anchor = s.position
                    edges += 1
                    diffuse = scattered_again(diffuse)
                    if wp.dot(leaves, direction) > 0.0 and (max_depth == 0 or edges <= max_depth):
                        carries = wp.cw_mul(throughput, sampled.weight) / rest
                        if wp.static(features.bent):
                            carries = carries * bump_shading(s, direction)
        origin = leave(s.position, leaves, offset_min)
        roulette_from = wp.int32(ROULETTE_FROM)
        if wp.static(features.traced):
            if way == PATH_WAY:
                roulette_from = ROULETTE_FROM_OF_PATHS
        most = SURVIVAL_MOST
        carry_on(
            p, carries, origin, direction, anchor, pdf, edges, diffuse, medium, roulette_from, most, seed, i, paths_out
        )

    @wp.func
    def query(
        surfaces: Surfaces,
        s: Surface,
        p: Vertex,
        throughput: wp.vec3,
        w_from: wp.vec3,
        way: wp.int32,
        i: wp.int32,
        queries_out: Queries,
        coats_out: Coats,
    ) -> wp.vec3:
        """Where photons are wanted, and for what. Returns the albedo of the surface, for its layer."""
        albedo = wp.vec3(0.0)
        weight = wp.vec3(0.0)
        if w_from[2] > 0.0 and has_diffuse(s.bsdf):
            albedo = s.bsdf.color
            weight = throughput
            if s.bsdf.kind == DIFFUSE:
                weight = wp.cw_mul(throughput, albedo)
        elif s.bsdf.kind != NULL and s.bsdf.kind != DIFFUSE:
            albedo = s.bsdf.specular
        if wp.static(features.traced):
            if way == PATH_WAY:
                weight = wp.vec3(0.0)
        queries_out.position[i] = s.position
        queries_out.normal[i] = s.normal
        queries_out.shading_normal[i] = s.shading_normal
        queries_out.front_normal[i] = s.normal
        if s.front == 0:
            queries_out.front_normal[i] = -s.normal
        queries_out.clearance[i] = clearance(surfaces, p.prim, s.position)
        queries_out.weight[i] = weight
        queries_out.edges[i] = p.edges
        if wp.static(features.bent):
            coats_out.unbent[i] = s.unbent
            coats_out.bumps2[i] = s.bumps2
        if wp.static(features.coated):
            coats_out.bsdf[i] = s.bsdf
            coats_out.s[i] = s.s
            coats_out.t[i] = s.t
            coats_out.n[i] = s.n
            coats_out.w_from[i] = w_from
        return albedo

    @wp.func
    def nothing_lit(p: Vertex, light_samples: wp.int32, j: wp.int32, row: wp.int32, shots_out: Shots) -> None:
        """A shadow ray that is not there."""
        shots_out.slot[row] = p.slot
        shots_out.place[row] = place_of(p.bounce, p.diffuse, light_samples, j)
        shots_out.radiance[row] = wp.vec3(0.0)

    @wp.func
    def nothing_seen(p: Vertex, i: wp.int32, seen_out: Seen, queries_out: Queries) -> None:
        """A vertex on no surface has nothing to show, and asks for no photons."""
        seen_out.emission[i] = wp.vec3(0.0)
        seen_out.depth[i] = -1.0
        seen_out.normal[i] = wp.vec3(0.0)
        seen_out.albedo[i] = wp.vec3(0.0)
        queries_out.weight[i] = wp.vec3(0.0)
        queries_out.edges[i] = p.edges

    @wp.func
    def stretch(p: Vertex, length: wp.float32, light_samples: wp.int32, i: wp.int32, stretches_out: Stretches) -> None:
        """The stretch of the ray before this vertex, if it is in a medium."""
        stretches_out.slot[i] = p.slot
        stretches_out.sample[i] = p.sample
        stretches_out.place[i] = place_of(p.bounce, p.diffuse, light_samples, light_samples + BEAM_PART)
        stretches_out.origin[i] = p.origin
        stretches_out.direction[i] = wp.normalize(p.direction)
        stretches_out.length[i] = length
        stretches_out.radiance[i] = p.throughput
        stretches_out.medium[i] = p.medium

    @wp.func
    def shade_surface(
        surfaces: Surfaces,
        materials: Materials,
        textures: Textures,
        lights: Lights,
        p: Vertex,
        throughput: wp.vec3,
        reached: wp.bool,
        light_samples: wp.int32,
        max_depth: wp.int32,
        way: wp.int32,
        action: wp.int32,
        seed: wp.uint32,
        eye: wp.vec3,
        i: wp.int32,
        seen_out: Seen,
        queries_out: Queries,
        coats_out: Coats,
        shots_out: Shots,
        paths_out: Paths,
    ) -> None:
        """A vertex on a surface.

        Args:
            throughput: of the path where it arrives.
            reached: whether light does; if not, only what the layers of depth, normals and albedo tell is told.
        """
        to_viewer = -wp.normalize(p.direction)
        u_choice = wp.float32(0.0)
        if wp.static(features.blend or features.passing):
            u_choice = number_1d(seed, p, CHOICE)
        s = surface_at(surfaces, materials, textures, p.prim, p.u, p.v, to_viewer, u_choice)
        w_from = to_local(s, to_viewer)

        diffuse_share = wp.float32(0.0)
        shines = max_depth == 0 or p.edges <= max_depth
        lit = lights.count > 0 and (max_depth == 0 or p.edges + 1 <= max_depth)
        if wp.static(features.traced):
            if way == PATH_WAY or (way == GATHER_WAY and action == TRACE_ON):
                diffuse_share = probability_diffuse(s.bsdf, w_from)
            if way == GATHER_WAY and p.diffuse > 0:
                shines = False
                lit = lit and action != READ_MAP

        emission = wp.vec3(0.0)
        if shines and reached:
            emission = emitted(textures, lights, p, s, throughput, light_samples)
        seen_out.emission[i] = emission
        seen_out.depth[i] = wp.length(s.position - eye)
        seen_out.normal[i] = s.shading_normal
        seen_out.albedo[i] = query(surfaces, s, p, throughput, w_from, way, i, queries_out, coats_out)
        if reached:
            for j in range(light_samples):
                row = i * light_samples + j
                if lit and s.bsdf.kind != BLACK and s.bsdf.kind != NULL:
                    direct(
                        lights,
                        materials,
                        textures,
                        s,
                        p,
                        throughput,
                        w_from,
                        diffuse_share,
                        way,
                        surfaces.offset_min,
                        light_samples,
                        seed,
                        j,
                        row,
                        shots_out,
                    )
                else:
                    nothing_lit(p, light_samples, j, row, shots_out)
            if wp.static(features.goes_on):
                go_on(
                    materials,
                    s,
                    p,
                    throughput,
                    w_from,
                    diffuse_share,
                    way,
                    surfaces.offset_min,
                    max_depth,
                    seed,
                    i,
                    paths_out,
                )

    @wp.func
    def shade(
        surfaces: Surfaces,
        materials: Materials,
        textures: Textures,
        media: Media,
        lights: Lights,
        p: Vertex,
        light_samples: wp.int32,
        max_depth: wp.int32,
        way: wp.int32,
        action: wp.int32,
        seed: wp.uint32,
        eye: wp.vec3,
        i: wp.int32,
        seen_out: Seen,
        queries_out: Queries,
        coats_out: Coats,
        shots_out: Shots,
        paths_out: Paths,
        stretches_out: Stretches,
    ) -> None:
        """A vertex on a surface, or, in PATH_WAY, in the medium before it."""
        throughput = p.throughput
        reached = wp.bool(True)
        if wp.static(features.media):
            length = length_to(lights, p)
            stretch(p, length, light_samples, i, stretches_out)
            if way != PATH_WAY:
                if p.medium >= 0:
                    throughput = wp.cw_mul(throughput, transmittance(media, p.medium, length))
            if wp.static(features.traced):
                if way == PATH_WAY:
                    flight = flight_of(media, lights, p, seed)
                    throughput = wp.cw_mul(throughput, flight.weight)
                    if flight.scatters == 1:
                        reached = wp.bool(False)
                        shade_medium(
                            media, lights, textures, p, flight, light_samples, max_depth, seed, i, shots_out, paths_out
                        )
        if p.prim >= 0:
            shade_surface(
                surfaces,
                materials,
                textures,
                lights,
                p,
                throughput,
                reached,
                light_samples,
                max_depth,
                way,
                action,
                seed,
                eye,
                i,
                seen_out,
                queries_out,
                coats_out,
                shots_out,
                paths_out,
            )
        else:
            nothing_seen(p, i, seen_out, queries_out)
            if reached:  # nowhere: only a peer that errs sends such a vertex
                for j in range(light_samples):
                    nothing_lit(p, light_samples, j, i * light_samples + j, shots_out)
                if wp.static(features.goes_on):
                    ends = wp.vec3(0.0)
                    carry_on(
                        p,
                        ends,
                        p.origin,
                        p.direction,
                        p.anchor,
                        p.pdf,
                        p.edges,
                        p.diffuse,
                        p.medium,
                        ROULETTE_FROM,
                        SURVIVAL_MOST,
                        seed,
                        i,
                        paths_out,
                    )

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def shade_camera_hits(
        surfaces: Surfaces,
        materials: Materials,
        textures: Textures,
        media: Media,
        lights: Lights,
        camera: CameraView,
        rays: Rays,
        light_samples: wp.int32,
        max_depth: wp.int32,
        offset: wp.int32,
        seen_out: Seen,
        queries_out: Queries,
        coats_out: Coats,
        shots_out: Shots,
        paths_out: Paths,
        stretches_out: Stretches,
    ) -> None:
        """Final hits of camera rays that lie in this cell.

        Args:
            light_samples: shadow segments a hit; segment j of hit i is number i * light_samples + j.
            max_depth: longest path in edges; 0 for no limit.
        """
        i = offset + wp.tid()
        shade(
            surfaces,
            materials,
            textures,
            media,
            lights,
            camera_vertex(camera, rays, i),
            light_samples,
            max_depth,
            MAP_WAY,
            TRACE_ON,
            camera.seed,
            camera.eye,
            i,
            seen_out,
            queries_out,
            coats_out,
            shots_out,
            paths_out,
            stretches_out,
        )

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def shade_vertices(
        surfaces: Surfaces,
        materials: Materials,
        textures: Textures,
        media: Media,
        lights: Lights,
        camera: CameraView,
        paths: Paths,
        light_samples: wp.int32,
        max_depth: wp.int32,
        way: wp.int32,
        actions: wp.array[wp.int32],
        offset: wp.int32,
        seen_out: Seen,
        queries_out: Queries,
        coats_out: Coats,
        shots_out: Shots,
        paths_out: Paths,
        stretches_out: Stretches,
    ) -> None:
        """As shade_camera_hits, for all vertices of camera paths, where paths go on.

        Args:
            way: what the diffuse parts of surfaces do: MAP_WAY, PATH_WAY or GATHER_WAY.
            actions: in GATHER_WAY, what the diffuse part of each vertex does.
        """
        i = offset + wp.tid()
        action = wp.int32(TRACE_ON)
        if wp.static(features.traced):
            if way == GATHER_WAY:
                action = actions[i]
        shade(
            surfaces,
            materials,
            textures,
            media,
            lights,
            camera_path(camera, paths, i),
            light_samples,
            max_depth,
            way,
            action,
            camera.seed,
            camera.eye,
            i,
            seen_out,
            queries_out,
            coats_out,
            shots_out,
            paths_out,
            stretches_out,
        )

    @wp.func
    def escaped(
        media: Media,
        lights: Lights,
        p: Vertex,
        light_samples: wp.int32,
        way: wp.int32,
        i: wp.int32,
        stretches_out: Stretches,
    ) -> wp.vec3:
        """What its environment and, without end, its medium send back to a ray that leaves the scene."""
        radiance = wp.vec3(0.0)
        if wp.static(features.environment):
            unit = wp.normalize(p.direction)
            radiance = environment_radiance(lights, unit)
            if wp.static(features.glossy or features.traced):
                if p.pdf > 0.0:
                    by_light = wp.float32(light_samples) * pdf_environment(lights, p.anchor, unit)
                    radiance = radiance * (p.pdf / (p.pdf + by_light))
            if wp.static(features.traced):
                if way == GATHER_WAY and p.diffuse > 0:
                    radiance = wp.vec3(0.0)
            radiance = wp.cw_mul(p.throughput, radiance)
        if wp.static(features.media):
            length = length_to(lights, p)
            stretch(p, length, light_samples, i, stretches_out)
            if way != PATH_WAY:
                if p.medium >= 0:
                    radiance = wp.cw_mul(radiance, transmittance(media, p.medium, length))
        return radiance

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def path_misses(
        media: Media,
        lights: Lights,
        cells: Cells,
        camera: CameraView,
        paths: Paths,
        light_samples: wp.int32,
        way: wp.int32,
        offset: wp.int32,
        radiance_out: wp.array[wp.vec3],
        collision_out: wp.array[wp.int32],
        stretches_out: Stretches,
    ) -> None:
        """Rays of camera paths that meet no surface.

        Args:
            collision_out: in PATH_WAY, the cell in which each path collides in its medium, -1 where it does not.
        """
        i = offset + wp.tid()
        p = camera_path(camera, paths, i)
        radiance = escaped(media, lights, p, light_samples, way, i, stretches_out)
        collision = wp.int32(-1)
        if wp.static(features.media and features.traced):
            if way == PATH_WAY:
                flight = flight_of(media, lights, p, camera.seed)
                radiance = wp.cw_mul(radiance, flight.weight)
                if flight.scatters == 1:
                    radiance = wp.vec3(0.0)
                    collision = cell_of(cells, collision_at(p, flight))
        radiance_out[i] = radiance
        collision_out[i] = collision

    return SimpleNamespace(
        shade_camera_hits=shade_camera_hits,
        shade_vertices=shade_vertices,
        path_misses=path_misses,
    )
