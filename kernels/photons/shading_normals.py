"""What interpolated and bent normals do to photons.

They make light transport asymmetric: what a path takes at a surface goes by where that is seen from, and a photon,
which comes from the light, has to bring just that (Veach 1997, section 5.3).
"""

from __future__ import annotations

import warp as wp

from wdpm.kernels.constants import ADJOINT_BOUND
from wdpm.kernels.materials.surface import Surface, is_turned_towards, lets_light_through, turned

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BUMPS_BOUND = wp.constant(16.0)
"""ADJOINT_BOUND of arrival at bumps, which are meant to lean far: light that grazes a wall is what shows them."""

LEAST_LEAN = wp.constant(0.05)
"""Sine of the angle by which a bent normal leans, at most, where photons do without what it brings to those who see it
turned: less than a thousandth of the light."""


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
    bound = ADJOINT_BOUND
    if s.bumps2 > 0.0:
        bound = BUMPS_BOUND
    return wp.min(in_shading / in_geometric, bound) * wp.min(out_geometric / out_shading, ADJOINT_BOUND)


@wp.struct
class Sides:
    """How a photon takes a normal that maps bend: as it is, or turned, as it is seen from the side that it leans from.

    Attributes:
        turned: which of both.
        weight: 1 over the chance of that; 0 where there is no such choice.
        left: of the number in [0, 1) that chose, what may choose further.
    """

    turned: bool
    weight: wp.float32
    left: wp.float32


@wp.func
def sides_of(s: Surface, to_source: wp.vec3, u: wp.float32) -> Sides:
    """The choice at a surface of light.

    Paths take a bent normal by where it is seen from: turned by half a turn where it would face away (frames.bend). So
    what a photon brings to directions from which it is seen as it is goes by that normal, and what it brings to others
    by the turned one. What lets light through is seen from behind as well: there both take it by where they come from.
    """
    sides = Sides()
    sides.left = u
    if lets_light_through(s):
        sides.turned = is_turned_towards(s, to_source)
        return sides
    cosine = wp.dot(s.unbent, s.n)
    lean = wp.sqrt(wp.max(1.0 - cosine * cosine, 0.0))
    chance = wp.float32(0.0)
    if lean > LEAST_LEAN:
        chance = lean / (1.0 + lean)  # about as the root of what goes where it is seen turned: the least variance
    sides.turned = u < chance
    if sides.turned:
        sides.weight = 1.0 / chance
        sides.left = u * sides.weight
    else:
        sides.weight = 1.0 / (1.0 - chance)
        sides.left = (u - chance) * sides.weight
    return sides


@wp.func
def share_of_side(s: Surface, sides: Sides, away: wp.vec3) -> wp.float32:
    """Weight of a photon that goes on at a surface with one of both normals; 0 in directions that see the other.

    Light that comes from behind the chosen one is not reflected at all.

    Args:
        s: with the chosen one.
    """
    if sides.weight == 0.0:
        return 1.0
    seen = s
    if sides.turned:
        seen = turned(s)
    if is_turned_towards(seen, away) != sides.turned:
        return 0.0
    return sides.weight
