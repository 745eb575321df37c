"""Frames in which scattering functions work, and how bump and normal maps bend them.

A frame follows the texture coordinates only where something can tell: s is then the tangent along u, made orthogonal to
the shading normal. Seen from behind, a two-sided surface has the mirror image of its front's frame, in the tangent
plane: bumps stay bumps, and grooves stay where they are.
"""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Frame:
    """Unit axes s, t and n of a surface point, and the derivatives of its position by u and v along them."""

    s: wp.vec3
    t: wp.vec3
    n: wp.vec3
    du: wp.vec3
    dv: wp.vec3


@wp.func
def tangent_of(n: wp.vec3) -> wp.vec3:
    """A unit vector perpendicular to a unit vector (Duff et al. 2017, "Building an Orthonormal Basis, Revisited")."""
    sign = wp.float32(1.0)
    if n[2] < 0.0:
        sign = -1.0
    a = -1.0 / (sign + n[2])
    return wp.vec3(1.0 + sign * n[0] * n[0] * a, sign * n[0] * n[1] * a, -sign * n[0])


@wp.func
def plain_frame(n: wp.vec3) -> Frame:
    """Any frame about a normal, the same wherever it is computed. Derivatives are unit tangents."""
    f = Frame()
    f.n = n
    f.s = tangent_of(n)
    f.t = wp.cross(n, f.s)
    f.du = wp.vec3(1.0, 0.0, 0.0)
    f.dv = wp.vec3(0.0, 1.0, 0.0)
    return f


@wp.func
def _in_frame(f: Frame, v: wp.vec3) -> wp.vec3:
    return wp.vec3(wp.dot(v, f.s), wp.dot(v, f.t), wp.dot(v, f.n))


@wp.func
def uv_frame(n: wp.vec3, dp_du: wp.vec3, dp_dv: wp.vec3) -> Frame:
    """The frame about a normal whose s follows u; a plain one where u has no direction across the normal.

    Args:
        dp_du, dp_dv: derivatives of position by u and v, of any length [scene unit].
    """
    f = plain_frame(n)
    along = dp_du - n * wp.dot(n, dp_du)
    length = wp.length(along)
    # Shorter ones are what rounding leaves of a derivative along the normal, or of none.
    if length > 1.0e-6 * wp.length(dp_du):
        s = along / length
        f.s = wp.normalize(s - n * wp.dot(n, s))  # what was left of a steep derivative is mostly rounding
        f.t = wp.cross(n, f.s)
        f.du = _in_frame(f, dp_du)
        f.dv = _in_frame(f, dp_dv)
    return f


@wp.func
def mirrored(f: Frame) -> Frame:
    """The frame seen from behind: local coordinates mean the same on both sides."""
    g = Frame()
    g.s = f.s
    g.t = f.t
    g.n = -f.n
    g.du = f.du
    g.dv = f.dv
    return g


@wp.func
def bumped_normal(f: Frame, slope: wp.vec2) -> wp.vec3:
    """The normal of a displaced surface in the frame of the flat one, not of unit length (Blinn 1978).

    Args:
        slope: derivatives of the displacement along the normal by u and v [scene unit]; the surface's own curvature is
            left out.
    """
    u = wp.vec3(f.du[0], f.du[1], slope[0])
    v = wp.vec3(f.dv[0], f.dv[1], slope[1])
    # In units of the larger one: what counts as no normal at all (bend) is then the same in any unit of length.
    per = 1.0 / wp.max(wp.max(wp.abs(u)), wp.max(wp.abs(v)))
    n = wp.cross(u * per, v * per)
    if n[2] < 0.0:  # where v runs the other way round
        n = -n
    return n


@wp.func
def bend(f: Frame, normal: wp.vec3, towards: wp.vec3) -> Frame:
    """The frame about another normal; its s is the old one, made orthogonal.

    Args:
        normal: in the frame, of any length; the frame stays as it is where that is 0 or not finite.
        towards: direction to where the path came from, in the world. A normal that faces away from it, on the side that
            is seen, is turned by half a turn about the old one. The zero vector turns none.
    """
    length = wp.length(normal)
    if not (length > 1.0e-12 and length < 1.0e30):
        return f
    n = normal / length
    w = _in_frame(f, towards)
    if w[2] * wp.dot(w, n) < 0.0:
        n = wp.vec3(-n[0], -n[1], n[2])
    s = wp.vec3(1.0 - n[0] * n[0], -n[0] * n[1], -n[0] * n[2])
    across = wp.length(s)
    if across < 1.0e-6:  # the normal lies along the old tangent
        s = tangent_of(n)
    else:
        s = s / across
    t = wp.cross(n, s)
    g = Frame()
    g.s = f.s * s[0] + f.t * s[1] + f.n * s[2]
    g.t = f.s * t[0] + f.t * t[1] + f.n * t[2]
    g.n = f.s * n[0] + f.t * n[1] + f.n * n[2]
    g.du = wp.vec3(wp.dot(f.du, s), wp.dot(f.du, t), wp.dot(f.du, n))
    g.dv = wp.vec3(wp.dot(f.dv, s), wp.dot(f.dv, t), wp.dot(f.dv, n))
    return g


@wp.func
def bend_roughness2(cos_bend: wp.float32) -> wp.float32:
    """Squared roughness of the bumps that bend a normal by an angle; 0 for a normal that is not bent.

    Source: Estevez, Lecocq & Stein 2019, "A Microfacet-Based Shadowing Function to Solve the Bump Terminator Problem".
    """
    c = wp.clamp(wp.abs(cos_bend), 1.0e-6, 1.0)
    return wp.min(0.125 * (1.0 - c * c) / (c * c), 1.0)


@wp.func
def bump_shadowing(roughness2: wp.float32, cos_light: wp.float32) -> wp.float32:
    """Share of light that bumps do not shadow, in (0, 1]; exactly 1 where roughness2 is 0 (same source).

    Args:
        roughness2: of `bend_roughness2`.
        cos_light: between the direction to the light and the normal that is not bent.
    """
    c = wp.clamp(wp.abs(cos_light), 1.0e-6, 1.0)
    return 2.0 / (1.0 + wp.sqrt(1.0 + roughness2 * (1.0 - c * c) / (c * c)))
