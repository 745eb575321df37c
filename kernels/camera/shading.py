"""What a camera path's vertex adds to its sample, and where the path goes on.

At every vertex: what the surface emits; direct light by shadow rays, over the surface's diffuse and glossy parts; a
query for photons where there is a diffuse part; and one ray that goes on (surface_vertices). What the diffuse part does
is told by `diffuse_light` (DiffuseLight):

* BY_MAP: it is never traced on. Photons are gathered where the camera path meets it, and the ray goes on by the glossy
  part, so each light path is counted once (photons/paths.py: which photons are stored).
* BY_PATHS: it is traced on like the glossy part, one of the two at each vertex, and no photon is asked: path tracing.
  Media scatter paths too (medium_vertices).
* BY_FINAL_GATHER: it is traced on once. Where such a ray arrives, the photon map is read, which then holds photons of
  direct light too (final gathering, Jensen 1996): `Action` says what each vertex does. Caustics are still gathered
  where the camera path or a short gather ray meets the surface, so what a gather ray finds of lamps, be it by glossy
  surfaces, does not count again.

Light that is found both by shadow rays and by the ray that goes on counts by both, weighted by multiple importance
sampling with the balance heuristic (Veach & Guibas 1995), for each part of a surface by itself.
"""

from __future__ import annotations

import functools
from types import SimpleNamespace

import warp as wp

from wdpm.kernels.camera.camera import CameraView, make_camera, whole_pixel
from wdpm.kernels.camera.medium_vertices import collision_at, flight_of, length_to, make_medium_vertices
from wdpm.kernels.camera.rays import Paths, Rays
from wdpm.kernels.camera.surface_vertices import make_surface_vertices
from wdpm.kernels.camera.vertices import (
    BY_FINAL_GATHER,
    BY_MAP,
    BY_PATHS,
    TRACE_ON,
    Coats,
    Orders,
    Queries,
    Seen,
    Shots,
    Stretches,
    Vertex,
    camera_path,
    nothing_goes_on,
    nothing_lit,
    nothing_seen,
    orders_of,
    stretch,
)
from wdpm.kernels.features import Features
from wdpm.kernels.lights.lights import Lights, make_lights
from wdpm.kernels.materials.medium import Media, transmittance
from wdpm.kernels.materials.resolve import Materials
from wdpm.kernels.materials.surface import Surfaces
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.rays.cells import Cells, cell_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@functools.cache
def make_shading(features: Features) -> SimpleNamespace:
    """Kernels for vertices of camera paths: `shade_camera_hits`, `shade_vertices`, `path_misses`."""
    light = make_lights(features)
    pdf_environment = light.pdf_environment
    environment_radiance = light.environment_radiance
    camera_ray = make_camera(features).camera_ray
    shade_surface = make_surface_vertices(features).shade_surface
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
    def shade(
        surfaces: Surfaces,
        materials: Materials,
        textures: Textures,
        media: Media,
        lights: Lights,
        p: Vertex,
        orders: Orders,
        seen_out: Seen,
        queries_out: Queries,
        coats_out: Coats,
        shots_out: Shots,
        paths_out: Paths,
        stretches_out: Stretches,
    ) -> None:
        """A vertex on a surface, or, in BY_PATHS, in the medium before it."""
        reached = wp.bool(True)
        if wp.static(features.media):
            throughput = p.throughput
            length = length_to(lights, p)
            stretch(p, length, orders.light_samples, orders.i, stretches_out)
            if orders.diffuse_light != BY_PATHS:
                if p.medium >= 0:
                    throughput = wp.cw_mul(throughput, transmittance(media, p.medium, length))
            if wp.static(features.traced):
                if orders.diffuse_light == BY_PATHS:
                    flight = flight_of(media, lights, p, orders.seed)
                    throughput = wp.cw_mul(throughput, flight.weight)
                    if flight.scatters == 1:
                        reached = wp.bool(False)
                        shade_medium(
                            media,
                            lights,
                            textures,
                            p,
                            flight,
                            orders,
                            shots_out,
                            paths_out,
                        )
            p.throughput = throughput
        if p.prim >= 0:
            shade_surface(
                surfaces,
                materials,
                textures,
                lights,
                p,
                reached,
                orders,
                seen_out,
                queries_out,
                coats_out,
                shots_out,
                paths_out,
            )
        else:
            nothing_seen(p, orders, seen_out, queries_out)
            if reached:  # nowhere: only a peer that errs sends such a vertex
                for j in range(orders.shots):
                    nothing_lit(p, orders, j, shots_out)
                if wp.static(features.goes_on):
                    nothing_goes_on(p, orders, paths_out)

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
            orders_of(camera, surfaces.offset_min, light_samples, light_samples, max_depth, BY_MAP, TRACE_ON, i),
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
        shots: wp.int32,
        diffuse_light: wp.int32,
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
            light_samples: shadow segments of what the camera sees.
            shots: shadow segments of each of these vertices; segment j of vertex i is number i * shots + j.
            diffuse_light: BY_MAP, BY_PATHS or BY_FINAL_GATHER.
            actions: in BY_FINAL_GATHER, what the diffuse part of each vertex does.
        """
        i = offset + wp.tid()
        action = wp.int32(TRACE_ON)
        if wp.static(features.traced):
            if diffuse_light == BY_FINAL_GATHER:
                action = actions[i]
        shade(
            surfaces,
            materials,
            textures,
            media,
            lights,
            camera_path(camera, paths, i),
            orders_of(camera, surfaces.offset_min, light_samples, shots, max_depth, diffuse_light, action, i),
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
        diffuse_light: wp.int32,
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
                    by_light = pdf_environment(lights, p.anchor, unit)
                    radiance = radiance * (p.pdf / (p.pdf + by_light))
            if wp.static(features.traced):
                if diffuse_light == BY_FINAL_GATHER and p.diffuse > 0:
                    radiance = wp.vec3(0.0)
            radiance = wp.cw_mul(p.throughput, radiance)
        if wp.static(features.media):
            length = length_to(lights, p)
            stretch(p, length, light_samples, i, stretches_out)
            if diffuse_light != BY_PATHS:
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
        diffuse_light: wp.int32,
        offset: wp.int32,
        radiance_out: wp.array[wp.vec3],
        collision_out: wp.array[wp.int32],
        stretches_out: Stretches,
    ) -> None:
        """Rays of camera paths that meet no surface.

        Args:
            collision_out: in BY_PATHS, the cell in which each path collides in its medium, -1 where it does not.
        """
        i = offset + wp.tid()
        p = camera_path(camera, paths, i)
        radiance = escaped(media, lights, p, light_samples, diffuse_light, i, stretches_out)
        collision = wp.int32(-1)
        if wp.static(features.media and features.traced):
            if diffuse_light == BY_PATHS:
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
