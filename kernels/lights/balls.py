"""Ways to lamps that are balls (scenes.flat.balls): even over the cone in which a ball is seen.

No place sees another part of a ball than its cone, and all of a cone is as bright: so light that is found by it has no
noise but that of the cosine at the place, however near the lamp or far away, and a lamp of thousands of triangles costs
no more than one (Wang 1992, "Physically correct direct lighting for distribution ray tracing").
"""

from __future__ import annotations

import warp as wp

from wdpm.kernels.constants import PI
from wdpm.kernels.lights.importance import LightNode
from wdpm.kernels.maths.directions import around, uniform_cone

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


CLEARANCE = wp.constant(2.0**-16)
ROUNDINGS = wp.constant(2.0**-21)
"""Shares of the radius and of the distances that the end's coordinates are made of: WayToBall.clearance."""


@wp.struct
class WayToBall:
    """A way from a place to a ball.

    Attributes:
        direction: unit.
        normal: of the ball that holds the lamp's mesh, where the way meets it; unit.
        end: that point.
        clearance: how far before it a shadow ray is to end, so that for certain none of the ball is in its way, and it
            need not look there (kernels.rays.ball_bounds). Some 2^-16 of the radius, and a few roundings of the way.
    """

    direction: wp.vec3
    normal: wp.vec3
    end: wp.vec3
    clearance: wp.float32


@wp.func
def _cone_height(radius: wp.float32, distance2: wp.float32) -> wp.float32:
    """1 - cos of half the angle in which a ball is seen."""
    sine2 = radius * radius / distance2
    return sine2 / (1.0 + wp.sqrt(wp.max(0.0, 1.0 - sine2)))


@wp.func
def solid_angle_of_ball(node: LightNode, ball: wp.float32, position: wp.vec3) -> wp.float32:
    """Solid angle in which a ball is seen from a place [sr]; 0 from within its mesh.

    Args:
        node: its leaf.
        ball: its radius.
    """
    distance2 = wp.length_sq(node.center - position)
    if distance2 <= node.radius2:
        return 0.0
    return 2.0 * PI * _cone_height(ball, distance2)


@wp.func
def way_to_ball(node: LightNode, ball: wp.float32, position: wp.vec3, u: wp.vec2) -> WayToBall:
    """A way to a ball with pdf_solid_angle = 1 / solid_angle_of_ball, for a place outside of its mesh.

    It ends where it comes to the mesh at the earliest: none of its triangles stands before the end.
    """
    way = node.center - position
    distance2 = wp.dot(way, way)
    distance = wp.sqrt(distance2)
    axis = way / distance
    local = uniform_cone(u, _cone_height(ball, distance2))
    across2 = local[0] * local[0] + local[1] * local[1]
    inwards = wp.sqrt(wp.max(0.0, node.radius2 - distance2 * across2))
    # From the centre on, where numbers are small: none of the way's roundings are left.
    length = distance * local[2] - inwards
    arm = around(axis, wp.vec3(local[0] * length, local[1] * length, -distance * across2 - local[2] * inwards))
    found = WayToBall()
    found.direction = around(axis, local)
    found.normal = wp.normalize(arm)
    found.end = node.center + arm
    place = wp.abs(node.center[0]) + wp.abs(node.center[1]) + wp.abs(node.center[2])
    found.clearance = CLEARANCE * node.radius + ROUNDINGS * (place + distance)
    return found
