"""All lights on a device, and what the choices among them have in common: choice.py, for a place; emission.py.

Elements are numbered glowing triangles first, then delta lights, those infinitely far away last, then the environment:
scenes.flat.light_table.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.constants import OFFSET_MIN_SHARE
from wdpm.kernels.lights import delta, environment
from wdpm.kernels.lights import tree as light_tree
from wdpm.kernels.lights.delta import DeltaLights
from wdpm.kernels.lights.environment import Environment
from wdpm.kernels.lights.guide import Guide
from wdpm.kernels.lights.tree import BELOW_ONE, LightTree
from wdpm.kernels.rays.ball_bounds import Balls
from wdpm.scenes.flat.areas import triangle_areas, triangle_normals
from wdpm.scenes.flat.light_table import LightTable

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FAR_AWAY_RADII = 4.0
"""Length of shadow rays to lights infinitely far away, in radii of the scene: from anywhere in it they end outside."""


@wp.struct
class Lights:
    """All light elements; fields as in scenes.flat.light_table, but for these.

    Attributes:
        count: how many elements there are, the first `triangles` of which are glowing triangles.
        first_distant: first element that is infinitely far away; first_environment: the environment, if there is one.
        deltas: follow the triangles.
        normal, area: of glowing triangles.
        tree: for the choice of elements that have a place.
        distant: by element infinitely far away, share of their power up to and with it; the last is 1.
        colored: 1 where there are vertex colours.
        far_away: where lights infinitely far away are taken to be.
        offset_min: least distance at which photons leave a surface.
        guide: what is known of which light reaches which place; nothing for photons.
    """

    count: wp.int32
    triangles: wp.int32
    first_distant: wp.int32
    first_environment: wp.int32
    prim: wp.array[wp.int32]
    corners: wp.array2d[wp.vec3]
    uvs: wp.array2d[wp.vec2]
    colored: wp.int32
    colors: wp.array2d[wp.vec3]
    normal: wp.array[wp.vec3]
    area: wp.array[wp.float32]
    emitter: wp.array[wp.int32]
    emitter_radiance: wp.array[wp.vec3]
    emitter_texture: wp.array[wp.int32]
    deltas: DeltaLights
    environment: Environment
    scene_radius: wp.float32
    far_away: wp.float32
    light: wp.array[wp.int32]
    medium: wp.array[wp.int32]
    tree: LightTree
    distant: wp.array[wp.float64]
    offset_min: wp.float32
    guide: Guide


def upload(table: LightTable, extent: float, device: str) -> Lights:
    """The lights on a device. Elements without power are never chosen.

    Args:
        extent: largest absolute coordinate of the scene.
    """
    lights = Lights()
    lights.count = len(table.power)
    lights.triangles = len(table.prim)
    lights.first_distant = lights.triangles + table.near
    lights.first_environment = lights.triangles + len(table.delta_kind)
    for name in ("emitter_radiance", "corners", "colors"):
        setattr(lights, name, wp.array(getattr(table, name), dtype=wp.vec3, device=device))
    for name in ("prim", "emitter", "emitter_texture", "light", "medium"):
        setattr(lights, name, wp.array(getattr(table, name), dtype=wp.int32, device=device))
    lights.uvs = wp.array(table.uvs, dtype=wp.vec2, device=device)
    lights.colored = int(len(table.colors) > 0)
    lights.normal = wp.array(triangle_normals(table.corners), dtype=wp.vec3, device=device)
    lights.area = wp.array(triangle_areas(table.corners).astype(np.float32), dtype=wp.float32, device=device)
    lights.deltas = delta.upload(table, device)
    lights.environment = environment.upload(table.environment_pixels, table.environment_axes, device)
    lights.scene_radius = table.scene_radius
    lights.far_away = FAR_AWAY_RADII * table.scene_radius
    lights.tree = light_tree.upload(table, device)
    lights.distant = upload_shares(table.power[lights.first_distant :], device)
    lights.offset_min = float(extent) * OFFSET_MIN_SHARE
    return lights


def balls(lights: Lights) -> Balls:
    """Which glowing meshes are balls."""
    leaf = lights.tree.ball_of.numpy()
    emitter = np.flatnonzero(leaf >= 0).astype(np.int32)
    return Balls(emitter, lights.tree.nodes.numpy()["center"][leaf[emitter]].reshape(-1, 3))


def guided(lights: Lights, guide: Guide, around: Environment) -> Lights:
    """The same lights, for shadow rays that choose among them with a guide.

    Args:
        around: the environment as the guide divides it: guide.guided_pixels.
    """
    view = Lights()
    struct: Any = Lights  # a warp struct, which type checkers take for the class that it was made of
    for name in struct.vars:
        setattr(view, name, getattr(lights, name))
    view.guide = guide
    view.environment = around
    return view


def upload_shares(weight: NDArray[np.float64], device: str) -> wp.array[wp.float64]:
    """Cumulative shares of elements from their weights, on a device; elements of weight 0 are never chosen."""
    cumulative = np.cumsum(weight)
    if len(weight) and cumulative[-1] > 0:
        cumulative /= cumulative[-1]
        cumulative[cumulative == cumulative[-1]] = 1.0  # trailing elements without power stay out of reach
    return wp.array(cumulative, dtype=wp.float64, device=device)


@wp.func
def choose_element(cumulative: wp.array[wp.float64], count: wp.int32, u: wp.float64) -> wp.int32:
    """The element whose share covers u: the first whose cumulative share exceeds it."""
    low = wp.int32(0)
    high = count - 1
    while low < high:
        middle = (low + high) // 2
        if cumulative[middle] <= u:
            low = middle + 1
        else:
            high = middle
    return low


@wp.func
def rest_of_choice(cumulative: wp.array[wp.float64], element: wp.int32, u: wp.float64) -> wp.float64:
    """Where in an element's share the number lies by which it was chosen, in [0, 1): as good as a fresh number."""
    before = wp.float64(0.0)
    if element > 0:
        before = cumulative[element - 1]
    return wp.clamp((u - before) / (cumulative[element] - before), wp.float64(0.0), BELOW_ONE)


@wp.func
def probability_of(cumulative: wp.array[wp.float64], element: wp.int32) -> wp.float32:
    """Probability with which an element is chosen."""
    before = wp.float64(0.0)
    if element > 0:
        before = cumulative[element - 1]
    return wp.float32(cumulative[element] - before)


@wp.func
def element_of_prim(lights: wp.ref[Lights], prim: wp.int32) -> wp.int32:
    """The element of a triangle by its global number; -1 where it does not glow."""
    if lights.triangles == 0:
        return -1
    low = wp.int32(0)
    high = lights.triangles - 1
    while low < high:
        middle = (low + high) // 2
        if lights.prim[middle] < prim:
            low = middle + 1
        else:
            high = middle
    if lights.prim[low] != prim:
        return -1
    return low


@wp.func
def point_of_triangle(lights: wp.ref[Lights], element: wp.int32, w: wp.vec2) -> wp.vec3:
    """A point of a glowing triangle by the weights of corners 1 and 2, combined in double and rounded once."""
    p0 = wp.vec3d(lights.corners[element, 0])
    p1 = wp.vec3d(lights.corners[element, 1])
    p2 = wp.vec3d(lights.corners[element, 2])
    return wp.vec3(p0 * wp.float64(1.0 - w[0] - w[1]) + p1 * wp.float64(w[0]) + p2 * wp.float64(w[1]))
