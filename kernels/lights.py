"""Choosing a light, a point on it and a direction from it."""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.constants import OFFSET_MIN_SHARE, PI
from wdpm.kernels.surface import leave

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class LightTable:
    """All light elements: emitting triangles first, then points. An element is chosen in proportion to its power."""

    triangles: wp.int32
    count: wp.int32
    corners: wp.array2d[wp.vec3]  # [triangles, 3]
    normal: wp.array[wp.vec3]  # by triangle
    radiance: wp.array[wp.vec3]  # by triangle
    area: wp.array[wp.float32]  # by triangle
    position: wp.array[wp.vec3]  # by point
    intensity: wp.array[wp.vec3]  # by point
    light: wp.array[wp.int32]  # by element: which light of the scene
    cumulative: wp.array[wp.float64]  # by element: share of the power up to and with it; the last is 1
    offset_min: wp.float32


@wp.struct
class LightSample:
    """A point of a light.

    Attributes:
        normal: of an emitting triangle; zero for a point light.
        radiance: of an emitting triangle; of a point light, its intensity.
        pdf: probability of the element, times density over its area for a triangle.
    """

    element: wp.int32
    position: wp.vec3
    normal: wp.vec3
    radiance: wp.vec3
    pdf: wp.float32


@wp.struct
class Emission:
    """A photon as it leaves a light. `flux` is that of a map of one path: divide by the number of paths."""

    light: wp.int32
    origin: wp.vec3
    direction: wp.vec3
    flux: wp.vec3


def upload(
    corners: NDArray[np.float32],
    radiance: NDArray[np.float32],
    position: NDArray[np.float32],
    intensity: NDArray[np.float32],
    light: NDArray[np.int32],
    power: NDArray[np.float64],
    extent: float,
    device: str,
) -> LightTable:
    """The lights on a device. Elements without power are never chosen."""
    table = LightTable()
    table.triangles = len(corners)
    table.count = len(power)
    table.corners = wp.array(corners, dtype=wp.vec3, device=device)
    table.normal = wp.array(triangle_normals(corners), dtype=wp.vec3, device=device)
    table.radiance = wp.array(radiance, dtype=wp.vec3, device=device)
    table.area = wp.array(triangle_areas(corners).astype(np.float32), dtype=wp.float32, device=device)
    table.position = wp.array(position, dtype=wp.vec3, device=device)
    table.intensity = wp.array(intensity, dtype=wp.vec3, device=device)
    table.light = wp.array(light, dtype=wp.int32, device=device)
    cumulative = np.cumsum(power)
    if len(power) and cumulative[-1] > 0:
        cumulative /= cumulative[-1]
        cumulative[cumulative == cumulative[-1]] = 1.0  # trailing elements without power stay out of reach
    table.cumulative = wp.array(cumulative, dtype=wp.float64, device=device)
    table.offset_min = float(extent) * OFFSET_MIN_SHARE
    return table


def triangle_areas(corners: NDArray[np.float32]) -> NDArray[np.float64]:
    """Areas of triangles, float64, shape [T]."""
    p = corners.astype(np.float64)
    return 0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)


def triangle_normals(corners: NDArray[np.float32]) -> NDArray[np.float32]:
    """Unit normals of triangles by their winding, computed in double: a cross product of needles cancels."""
    p = corners.astype(np.float64)
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    unit: NDArray[np.float32] = (normal / np.linalg.norm(normal, axis=1, keepdims=True)).astype(np.float32)
    return unit


@wp.func
def choose_element(lights: LightTable, u: wp.float64) -> wp.int32:
    """The element whose share of the power covers u: the first whose cumulative share exceeds it."""
    low = wp.int32(0)
    high = lights.count - 1
    while low < high:
        middle = (low + high) // 2
        if lights.cumulative[middle] <= u:
            low = middle + 1
        else:
            high = middle
    return low


@wp.func
def share_before(lights: LightTable, element: wp.int32) -> wp.float64:
    """Cumulative share of the power of all elements before one."""
    share = wp.float64(0.0)
    if element > 0:
        share = lights.cumulative[element - 1]
    return share


@wp.func
def triangle_weights(u: wp.vec2) -> wp.vec2:
    """Uniform barycentric weights of corners 1 and 2 from a point of the unit square (Heitz 2019, low distortion)."""
    b0 = u[0]
    b1 = u[1]
    if u[1] > u[0]:
        b0 = 0.5 * u[0]
        b1 = u[1] - b0
    else:
        b1 = 0.5 * u[1]
        b0 = u[0] - b1
    return wp.vec2(b0, b1)


@wp.func
def sample_light(lights: LightTable, u_element: wp.float64, u_position: wp.vec2) -> LightSample:
    """A point of the lights, chosen in proportion to power and uniformly over a triangle."""
    element = choose_element(lights, u_element)
    probability = wp.float32(lights.cumulative[element] - share_before(lights, element))
    s = LightSample()
    s.element = element
    if element < lights.triangles:
        w = triangle_weights(u_position)
        p0 = lights.corners[element, 0]
        p1 = lights.corners[element, 1]
        p2 = lights.corners[element, 2]
        a = wp.vec3d(p0)
        s.position = wp.vec3(
            a * wp.float64(1.0 - w[0] - w[1]) + wp.vec3d(p1) * wp.float64(w[0]) + wp.vec3d(p2) * wp.float64(w[1])
        )
        s.normal = lights.normal[element]
        s.radiance = lights.radiance[element]
        s.pdf = probability / lights.area[element]
    else:
        point = element - lights.triangles
        s.position = lights.position[point]
        s.radiance = lights.intensity[point]
        s.pdf = probability
    return s


@wp.func
def sincos_octant(x: wp.float32) -> wp.vec2:
    """Sine and cosine of pi/4 x for x in [-1, 1], to 1e-7.

    Polynomials, not the C library's functions: those differ between its versions, and the image must not.
    """
    a = (0.25 * PI) * x
    a2 = a * a
    sine = a * (1.0 + a2 * (-1.6666667e-1 + a2 * (8.3333310e-3 + a2 * (-1.9840874e-4 + a2 * 2.7525562e-6))))
    cosine = 1.0 + a2 * (-0.5 + a2 * (4.1666667e-2 + a2 * (-1.3888889e-3 + a2 * (2.4801587e-5 - a2 * 2.7557319e-7))))
    return wp.vec2(sine, cosine)


@wp.func
def concentric_disk(u: wp.vec2) -> wp.vec2:
    """The unit square mapped to the unit disk, keeping areas and neighbours (Shirley & Chiu 1997)."""
    x = 2.0 * u[0] - 1.0
    y = 2.0 * u[1] - 1.0
    if wp.abs(x) > wp.abs(y):
        sc = sincos_octant(y / x)
        return wp.vec2(x * sc[1], x * sc[0])
    if y == 0.0:
        return wp.vec2(0.0, 0.0)
    sc = sincos_octant(x / y)
    return wp.vec2(y * sc[0], y * sc[1])


@wp.func
def around(normal: wp.vec3, local: wp.vec3) -> wp.vec3:
    """A direction given in a frame whose z axis is `normal` (Duff et al. 2017).

    The frame is orthonormal to float32's rounding, so a direction of length 1 keeps it to 2e-7 without being
    normalized again, whose square root and division would take a twentieth of a photon's time.
    """
    sign = wp.float32(1.0)
    if normal[2] < 0.0:
        sign = -1.0
    a = -1.0 / (sign + normal[2])
    b = normal[0] * normal[1] * a
    x = wp.vec3(1.0 + sign * normal[0] * normal[0] * a, sign * b, -sign * normal[0])
    y = wp.vec3(b, sign + normal[1] * normal[1] * a, -normal[1])
    return x * local[0] + y * local[1] + normal * local[2]


@wp.func
def cosine_hemisphere(normal: wp.vec3, u: wp.vec2) -> wp.vec3:
    """A direction with pdf_solid_angle = cos / pi about `normal`."""
    d = concentric_disk(u)
    z = wp.sqrt(wp.max(0.0, 1.0 - d[0] * d[0] - d[1] * d[1]))
    return around(normal, wp.vec3(d[0], d[1], z))


@wp.func
def uniform_sphere(u: wp.vec2) -> wp.vec3:
    """A direction with pdf_solid_angle = 1 / (4 pi): the disk wrapped around the sphere, areas kept (Lambert)."""
    d = concentric_disk(u)
    r2 = d[0] * d[0] + d[1] * d[1]
    shrink = 2.0 * wp.sqrt(wp.max(0.0, 1.0 - r2))
    return wp.vec3(d[0] * shrink, d[1] * shrink, 1.0 - 2.0 * r2)


@wp.func
def emit(lights: LightTable, u_element: wp.float64, u_position: wp.vec2, u_direction: wp.vec2) -> Emission:
    """A photon from the lights, chosen in proportion to power, so that all photons carry much the same flux."""
    s = sample_light(lights, u_element, u_position)
    e = Emission()
    e.light = lights.light[s.element]
    if s.element < lights.triangles:
        e.origin = leave(s.position, s.normal, lights.offset_min)
        e.direction = cosine_hemisphere(s.normal, u_direction)
        e.flux = s.radiance * (PI / s.pdf)
    else:
        e.origin = s.position
        e.direction = uniform_sphere(u_direction)
        e.flux = s.radiance * (4.0 * PI / s.pdf)
    return e
