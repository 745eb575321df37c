"""What a camera path's vertex adds to its sample, and where the path goes on.

At every vertex: what the surface emits; direct light by shadow rays, over the surface's diffuse and glossy parts; a
query for photons where there is a diffuse part; and one ray that goes on (surface_vertices). What the diffuse part does
is told by `diffuse_light` (DiffuseLight):

* BY_MAP: it is never traced on. Photons are gathered where the camera path meets it, and the ray goes on by the glossy
  part, so each light path is counted once (photons/paths.py: which photons are stored).
* BY_PATHS: it is traced on like the glossy part, one of the two at each vertex, and no photon is asked: path tracing.
  Media scatter paths too (medium_vertices).
* BY_FINAL_GATHER: it is traced on once. Where such a ray arrives, irradiance is read that was computed from photons
  (final gathering, Jensen 1996): `actions` says what each vertex does. Direct light and caustics are found at every
  vertex, as ever, so what a gather ray finds of lamps, be it by glossy surfaces, does not count again.

Light that is found both by shadow rays and by the ray that goes on counts by both, weighted by multiple importance
sampling with the balance heuristic (Veach & Guibas 1995), for each part of a surface by itself.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import warp as wp

from wdpm.kernels.camera.medium_vertices import length_to, make_flight_of, make_shade_medium
from wdpm.kernels.camera.paths import Paths, Vertex, camera_path
from wdpm.kernels.camera.rays import Rays, make_first_vertex
from wdpm.kernels.camera.scene import Scene
from wdpm.kernels.camera.surface_vertices import make_shade_surface
from wdpm.kernels.camera.vertices import (
    BY_FINAL_GATHER,
    BY_PATHS,
    TRACE_ON,
    Orders,
    Shaded,
    nothing_goes_on,
    nothing_seen,
    shoot,
    shot_of,
    stretch,
)
from wdpm.kernels.features import Features
from wdpm.kernels.made_for import made_for
from wdpm.kernels.materials.flights import make_flights

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@dataclass(frozen=True)
class Shading:
    """Kernels for vertices of camera paths."""

    shade_camera_hits: wp.Kernel
    shade_vertices: wp.Kernel


@functools.cache
def make_shade(features: Features) -> wp.Function:
    """The function `shade` for a set of features: (scene, p, orders, shaded_out)."""
    shade_surface = make_shade_surface(features)
    shade_medium = make_shade_medium(features)
    flight_of = make_flight_of(features)
    transmittance_of = make_flights(features).transmittance_of

    @wp.func
    def shade(scene: wp.ref[Scene], p: Vertex, orders: Orders, shaded_out: wp.ref[Shaded]) -> None:
        """A vertex on a surface, or, in BY_PATHS, in the medium before it."""
        reached = wp.bool(True)
        if wp.static(features.media):
            throughput = p.throughput
            length = length_to(scene.lights, p)
            stretch(p, length, orders.light_samples, shaded_out.stretches)
            if orders.diffuse_light != BY_PATHS:
                if p.medium >= 0:
                    along = wp.normalize(p.direction)
                    through = transmittance_of(scene.media, p.medium, p.origin, along, length)
                    throughput = wp.cw_mul(throughput, through)
            if wp.static(features.traced):
                if orders.diffuse_light == BY_PATHS:
                    flight = flight_of(scene.media, scene.lights, p, scene.camera.seed)
                    throughput = wp.cw_mul(throughput, flight.weight)
                    if flight.scatters == 1:
                        reached = wp.bool(False)
                        shade_medium(scene, p, flight, orders, shaded_out)
            p.throughput = throughput
        if p.prim >= 0:
            shade_surface(scene, p, reached, orders, shaded_out)
        else:
            nothing_seen(p, shaded_out.seen, shaded_out.queries)
            if reached:  # nowhere: only a peer that errs sends such a vertex
                for j in range(orders.shots):
                    shoot(p, orders, j, shot_of(p, p.diffuse, orders, j), shaded_out.shots)
                if wp.static(features.goes_on):
                    nothing_goes_on(p, scene.camera.seed, shaded_out.paths)

    return shade


@functools.cache
def make_shading(features: Features) -> Shading:
    """The kernels for a set of features."""
    first_vertex = make_first_vertex(features)
    shade = make_shade(features)

    @made_for(features)
    def shade_camera_hits(scene: Scene, rays: Rays, orders: Orders, offset: wp.int32, shaded_out: Shaded) -> None:
        """Final hits of camera rays that lie in this cell.

        Args:
            orders: by BY_MAP.
        """
        shade(scene, first_vertex(scene.camera, rays, offset + wp.tid()), orders, shaded_out)

    @made_for(features)
    def shade_vertices(
        scene: Scene,
        paths: Paths,
        orders: Orders,
        actions: wp.array[wp.int32],
        offset: wp.int32,
        shaded_out: Shaded,
    ) -> None:
        """As shade_camera_hits, for all vertices of camera paths, where paths go on.

        Args:
            actions: in BY_FINAL_GATHER, what the diffuse part of each vertex does.
        """
        i = offset + wp.tid()
        p = camera_path(scene.camera, paths, i)
        p.action = TRACE_ON
        if wp.static(features.traced):
            if orders.diffuse_light == BY_FINAL_GATHER:
                p.action = actions[i]
        shade(scene, p, orders, shaded_out)

    return Shading(shade_camera_hits, shade_vertices)
