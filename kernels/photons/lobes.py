"""What caustic photons tell of where a caustic comes from: a target for each, and how well it tells of its neighbours.

From a photon that came to p from direction d it follows that light comes from p + v d, however far away that may be.
A flat mirror shows the image of its lamp as far behind it as the lamp is before it: v is the length of the light's way,
and the image stands still while the eye moves. A ball shows it nearer, a hollow mirror farther away, and what stands
still seen through glass is anywhere. So several v are tried, and that is taken from which the photons that landed
nearby are told best.
"""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

TOLD = wp.constant(4)
"""Photons of the neighbourhood that the direction to a target is to tell."""

WIDER = wp.constant(wp.float32(2.0))
"""1 - cos at a lobe's rim over that of the photon told last: what was found to be nearest is farther for others."""

LEAST_RIM = wp.constant(wp.float32(1e-6))
"""A lobe's width at least, as 1 - cos: a twelfth of a degree."""

MOST_RIM = wp.constant(wp.float32(1.0))
"""And at most: a hemisphere."""

CLEARLY = wp.constant(wp.float32(0.8))
"""Width that another distance must leave of the best one before: all are tried on few photons."""

_SPHERE = wp.constant(wp.float32(2.0))
_DISTANCES = wp.constant(7)
_FAR = wp.constant(wp.float32(100.0))


@wp.func
def _distance(number: wp.int32, near: wp.float32, far: wp.float32) -> wp.float32:
    """The distances that are tried, that of a flat mirror first."""
    if number == 1:
        return near + 0.5 * (far - near)
    if number == 2:
        return near + 0.25 * (far - near)
    if number == 3:
        return near + 0.1 * (far - near)
    if number == 4:
        return 0.5 * near
    if number == 5:
        return 2.0 * far
    if number == 6:
        return _FAR * far
    return far


@wp.kernel
def fit_lobes(
    position: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    light: wp.array[wp.int32],
    near: wp.array[wp.float32],
    far: wp.array[wp.float32],
    first: wp.array[wp.int32],
    region: wp.array[wp.int32],
    offset: wp.int32,
    target_out: wp.array[wp.vec3],
    rim_out: wp.array[wp.float32],
) -> None:
    """The lobe of each of some photons that are sorted by region.

    Args:
        direction: that it came from.
        near, far: how far back it was reflected last, and how long its way from the light was.
        first: of each region's photons, and one more past the last.
    """
    i = offset + wp.tid()
    best = wp.float32(_SPHERE)
    target_out[i] = position[i] + direction[i] * far[i]
    for number in range(_DISTANCES):
        target = position[i] + direction[i] * _distance(number, near[i], far[i])
        nearest = wp.vec4(_SPHERE, _SPHERE, _SPHERE, _SPHERE)  # TOLD of them, in order
        for j in range(first[region[i]], first[region[i] + 1]):
            if j != i and light[j] == light[i]:
                apart = wp.normalize(target - position[j]) - direction[j]
                off = 0.5 * wp.dot(apart, apart)
                for k in range(TOLD):
                    if off < nearest[k]:
                        held = nearest[k]
                        nearest[k] = off
                        off = held
        if nearest[TOLD - 1] < CLEARLY * best or (number == 0 and nearest[TOLD - 1] < best):
            best = nearest[TOLD - 1]
            target_out[i] = target
    rim_out[i] = wp.clamp(WIDER * best, LEAST_RIM, MOST_RIM)
