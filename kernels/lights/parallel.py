"""Photons of parallel light, from a directional light or from one direction of an environment."""

from __future__ import annotations

import warp as wp

from wdpm.kernels.constants import PI
from wdpm.kernels.lights.elements import Lights
from wdpm.kernels.lights.photon_targets import Targets, aim_parallel, sum_of_discs
from wdpm.kernels.lights.samples import Emission
from wdpm.kernels.maths.directions import around, concentric_disk

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def parallel_emission(
    lights: wp.ref[Lights],
    targets: wp.ref[Targets],
    aimed: wp.int32,
    direction: wp.vec3,
    irradiance: wp.vec3,
    u_target: wp.float32,
    u: wp.vec2,
) -> Emission:
    """A photon of parallel light: through a point of the scene's silhouette, or of the spheres'."""
    emitted = Emission()
    emitted.direction = direction
    radius = lights.scene_radius
    total = wp.float32(0.0)
    if aimed == 1:
        total = sum_of_discs(targets)
    through = wp.vec3(0.0)
    if total > 0.0 and total < radius * radius:
        a = aim_parallel(targets, direction, total, u_target, u)
        through = a.vector
        emitted.flux = irradiance / a.pdf
    else:
        d = concentric_disk(u) * radius
        through = around(direction, wp.vec3(d[0], d[1], 0.0))
        emitted.flux = irradiance * (PI * radius * radius)
    # It starts where its line enters the scene's sphere.
    through = through - direction * wp.dot(through, direction)
    emitted.origin = through - direction * wp.sqrt(wp.max(0.0, radius * radius - wp.dot(through, through)))
    return emitted
