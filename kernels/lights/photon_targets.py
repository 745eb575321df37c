"""Where photons of the caustic pass are aimed: spheres that hold all that is specular.

The union of a few spheres stands for the specular surfaces. From a point, a sphere subtends a cone; a direction is
chosen uniformly in one of the cones, and since cones overlap, its density is (cones that hold it) / (sum of all solid
angles). So every direction that meets a sphere is sampled with a density that is known, and none that meets a specular
surface is left out. For parallel light, discs stand for cones.

Where the sum is no less than the measure of the light's own directions (a point within a sphere, spheres all around),
aiming gains nothing, and the light's own distribution is used.
"""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.constants import PI
from wdpm.kernels.maths.directions import around, concentric_disk, uniform_cone

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Targets:
    """Spheres; count 0 where photons are not aimed."""

    count: wp.int32
    center: wp.array[wp.vec3]
    radius: wp.array[wp.float32]


@wp.struct
class Aim:
    """A direction towards a sphere (or, for parallel light, a point in a sphere's silhouette) and its density.

    Attributes:
        vector: direction, unit, or point.
        pdf: pdf_solid_angle, or density over the silhouettes' area; 0 where no sphere can be met.
    """

    vector: wp.vec3
    pdf: wp.float32


def upload_targets(center: NDArray[np.float32], radius: NDArray[np.float32], device: str) -> Targets:
    """Spheres on a device."""
    targets = Targets()
    targets.count = len(radius)
    targets.center = wp.array(center, dtype=wp.vec3, device=device)
    targets.radius = wp.array(radius, dtype=wp.float32, device=device)
    return targets


@wp.func
def cone_height(targets: wp.ref[Targets], target: wp.int32, origin: wp.vec3) -> wp.float32:
    """1 - cos of the half angle that a sphere subtends; 4, which is more than any, from inside of it."""
    d = targets.center[target] - origin
    distance2 = wp.dot(d, d)
    r2 = targets.radius[target] * targets.radius[target]
    if distance2 <= r2:
        return 4.0
    sine2 = r2 / distance2
    return sine2 / (1.0 + wp.sqrt(1.0 - sine2))


@wp.func
def _lit(
    targets: wp.ref[Targets], target: wp.int32, origin: wp.vec3, axis: wp.vec3, cutoff: wp.float32, height: wp.float32
) -> wp.bool:
    """Whether a sphere reaches into the light's own cone about `axis`: cos of angle to it above cos(cutoff + alpha)."""
    d = wp.normalize(targets.center[target] - origin)
    cosine = 1.0 - height
    if height > 2.0 or cutoff <= -cosine:  # inside, or both cones together are all directions
        return True
    sines = wp.sqrt((1.0 - cutoff * cutoff) * height * (2.0 - height))
    return wp.dot(axis, d) > cutoff * cosine - sines - 1.0e-5


@wp.func
def sum_of_cones(targets: wp.ref[Targets], origin: wp.vec3, axis: wp.vec3, cutoff: wp.float32) -> wp.float32:
    """Sum of the cones' heights (solid angle / 2 pi) of all spheres that a light of a half angle can reach.

    Args:
        axis: of the light's own cone.
        cutoff: cosine of that cone's half angle; 0 for a hemisphere, -1 for all directions.
    """
    total = wp.float32(0.0)
    for i in range(targets.count):
        height = cone_height(targets, i, origin)
        if _lit(targets, i, origin, axis, cutoff, height):
            total += height
    return total


@wp.func
def aim(
    targets: wp.ref[Targets],
    origin: wp.vec3,
    axis: wp.vec3,
    cutoff: wp.float32,
    total: wp.float32,
    u_target: wp.float32,
    u: wp.vec2,
) -> Aim:
    """A direction from `origin` to one of the spheres, none of which it is in.

    Args:
        total: sum_of_cones of the same; below 2.
    """
    a = Aim()
    if total <= 0.0:
        return a
    chosen = wp.int32(-1)
    before = wp.float32(0.0)
    chosen_height = wp.float32(0.0)
    for i in range(targets.count):
        height = cone_height(targets, i, origin)
        if _lit(targets, i, origin, axis, cutoff, height) and (chosen < 0 or before <= u_target * total):
            chosen = i
            chosen_height = height
            before += height
    a.vector = around(wp.normalize(targets.center[chosen] - origin), uniform_cone(u, chosen_height))
    covering = wp.int32(1)
    for i in range(targets.count):
        if i != chosen and _lit(targets, i, origin, axis, cutoff, cone_height(targets, i, origin)):
            d = targets.center[i] - origin
            along = wp.dot(d, a.vector)
            aside = d - a.vector * along
            if along > 0.0 and wp.dot(aside, aside) <= targets.radius[i] * targets.radius[i]:
                covering += 1
    a.pdf = wp.float32(covering) / (2.0 * PI * total)
    return a


@wp.func
def sum_of_discs(targets: wp.ref[Targets]) -> wp.float32:
    """Sum of the squared radii of all silhouettes."""
    total = wp.float32(0.0)
    for i in range(targets.count):
        total += targets.radius[i] * targets.radius[i]
    return total


@wp.func
def aim_parallel(
    targets: wp.ref[Targets], direction: wp.vec3, total: wp.float32, u_target: wp.float32, u: wp.vec2
) -> Aim:
    """A point in the silhouette of one of the spheres, seen along `direction`; it lies near that sphere's centre.

    Args:
        total: sum_of_discs; above 0.
    """
    chosen = wp.int32(-1)
    before = wp.float32(0.0)
    for i in range(targets.count):
        if chosen < 0 or before <= u_target * total:
            chosen = i
            before += targets.radius[i] * targets.radius[i]
    d = concentric_disk(u) * targets.radius[chosen]
    a = Aim()
    a.vector = targets.center[chosen] + around(direction, wp.vec3(d[0], d[1], 0.0))
    covering = wp.int32(1)
    for i in range(targets.count):
        if i != chosen:
            to = targets.center[i] - a.vector
            aside = to - direction * wp.dot(to, direction)
            if wp.dot(aside, aside) <= targets.radius[i] * targets.radius[i]:
                covering += 1
    a.pdf = wp.float32(covering) / (PI * total)
    return a
