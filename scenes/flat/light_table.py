"""All lights of a scene as arrays: what kernels read and what travels to slaves.

A light is chosen element by element: each glowing triangle is one, and so is every other light. Elements are numbered
triangles first, then points, spots, directionals, environment. What needs a C library's sine or arc cosine is computed
here, once, by the master.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.flat.areas import triangle_areas
from wdpm.scenes.flat.material_table import NO_MEDIUM
from wdpm.scenes.flat.reach import radius_about_origin
from wdpm.scenes.model.light_kind import NUMBERS
from wdpm.scenes.model.light_power import environment_integral, triangle_means
from wdpm.scenes.model.lights import DELTA_LIGHTS, DeltaLight, Environment, Light, axes_of
from wdpm.scenes.model.textures import Texture

if TYPE_CHECKING:
    from wdpm.scenes.flat.arrays import Triangles
    from wdpm.scenes.model.scene import Camera, Solid

LIGHT_KINDS = {light.KIND.number: light.KIND for light in DELTA_LIGHTS}
"""Kinds of delta lights by their numbers."""

_DISTANT = [number for number, kind in LIGHT_KINDS.items() if kind.distant]

RADIUS_MARGIN = 1.0 + 2.0**-10
"""The scene's sphere is grown by a thousandth: photons and shadow rays start on it, certainly outside all surfaces."""


@dataclass(frozen=True, eq=False)
class LightTable:
    """All that emits, in the renderer's space (renderer_space): areas, fluxes and intensities are in its units.

    Attributes:
        emitter_radiance: of glowing meshes, a factor where there is a texture [W/(m² sr)], float32, shape [M, 3].
        emitter_texture: index into the textures, -1 for none, int32, shape [M].
        prim: global numbers of glowing triangles, ascending, int32, shape [E].
        corners: wound so that their geometric normals face the lit side, float32, shape [E, 3, 3].
        uvs: float32, shape [E, 3, 2].
        colors: vertex colours, float32, shape [E, 3, 3]; [0, 3, 3] in a scene without any.
        emitter: which glowing mesh, int32, shape [E].
        delta_kind: of each light without area, scenes.model.light_kind; ascending, so that those infinitely far away
            come last; int32, shape [D].
        delta_position: float32, shape [D, 3]; zero for what is infinitely far away.
        delta_axes: rows are the light's x, y and z axes in the world; it shines along z. float32, shape [D, 3, 3].
        delta_color: strength, in terms of its kind: intensity [W/sr] or irradiance [W/m²], float32, shape [D, 3].
        delta_cutoff: cosine of the half angle about its axis beyond which there is no light, float32, shape [D].
        delta_number: what its kind names (LightKind.numbers), float32, shape [D, NUMBERS].
        delta_texture: index into the textures, -1 for none, int32, shape [D].
        environment_pixels: as scenes.model.lights.Environment, float32, shape [H, W, 3]; [0, 0, 3] without one.
        environment_axes: rows are the local axes in the world, float32, shape [3, 3].
        scene_radius: of a sphere about the origin that holds all triangles, with RADIUS_MARGIN.
        medium: that the rays of each element start in, -1 for none, int32, shape [elements].
        power: flux of each element, mean of RGB [W], float64, shape [elements].
        light: which light each element belongs to, int32, shape [elements].
        names: of the lights: glowing meshes, delta lights, environment.
    """

    emitter_radiance: NDArray[np.float32]
    emitter_texture: NDArray[np.int32]
    prim: NDArray[np.int32]
    corners: NDArray[np.float32]
    uvs: NDArray[np.float32]
    colors: NDArray[np.float32]
    emitter: NDArray[np.int32]
    delta_kind: NDArray[np.int32]
    delta_position: NDArray[np.float32]
    delta_axes: NDArray[np.float32]
    delta_color: NDArray[np.float32]
    delta_cutoff: NDArray[np.float32]
    delta_number: NDArray[np.float32]
    delta_texture: NDArray[np.int32]
    environment_pixels: NDArray[np.float32]
    environment_axes: NDArray[np.float32]
    scene_radius: float
    medium: NDArray[np.int32]
    power: NDArray[np.float64]
    light: NDArray[np.int32]
    names: tuple[str, ...]

    @property
    def near(self) -> int:
        """How many of the delta lights have a place: the first so many."""
        return int(np.count_nonzero(~np.isin(self.delta_kind, _DISTANT)))


def tabulate_lights(
    emitters: Sequence[Solid],
    triangles: Triangles,
    emitter_texture: NDArray[np.int32],
    textures: Sequence[Texture],
    lights: Sequence[Light],
    sides: NDArray[np.int32] | None = None,
    camera: Camera | None = None,
) -> LightTable:
    """The table of a scene's lights.

    Args:
        emitters: the meshes that Triangles.emitter numbers.
        triangles: all of the scene.
        emitter_texture: of each emitter, an index into `textures` or -1, shape [M].
        textures: must hold those of spots, too.
        lights: in the renderer's space.
        sides: media behind and before each triangle as MaterialTable.medium has them, int32, shape [T, 2]; None in a
            scene without media. They tell which medium a light is in that names none.
        camera: in the renderer's space. The medium around it is that of all places which no boundary parts from it.

    Raises:
        SceneError: more than one environment, one that is too small, a spot's texture that is not in `textures`, or a
            light that no float holds.
    """
    deltas = sorted((light for light in lights if isinstance(light, DeltaLight)), key=lambda light: light.KIND.number)
    environment = _only([light for light in lights if isinstance(light, Environment)])
    rows = np.flatnonzero(triangles.emitter >= 0)
    emitter = triangles.emitter[rows].astype(np.int32)
    corners, uvs, colors = _facing_front(triangles, rows)
    radiance = _float32([_factor(mesh, int(t)) for mesh, t in zip(emitters, emitter_texture, strict=True)], (-1, 3))
    radius = radius_about_origin(triangles) * RADIUS_MARGIN
    pixels = _pixels(environment)
    others: list[Light] = [*deltas, *environment]
    powers = [
        _triangle_power(corners, uvs, colors, emitter, radiance, emitter_texture, textures),
        [light.power(radius) for light in deltas],
        [math.pi * radius**2 * environment_integral(pixels) for _ in environment],
    ]
    inside = _Enclosure(triangles, sides, camera)
    of_triangles = np.empty(len(rows), np.int32)
    for number, mesh in enumerate(emitters):
        own = np.flatnonzero(emitter == number)
        of_triangles[own] = _mesh_media(mesh, corners[own], inside)
    media = np.concatenate([of_triangles, np.array([_medium(light, inside) for light in others], np.int32)])
    delta_rows = [light.row() for light in deltas]
    _check_strengths(deltas, [row.color for row in delta_rows])
    return LightTable(
        emitter_radiance=radiance,
        emitter_texture=np.asarray(emitter_texture, np.int32),
        prim=triangles.ids[rows].astype(np.int32),
        corners=corners,
        uvs=uvs,
        colors=colors,
        emitter=emitter,
        delta_kind=np.array([light.KIND.number for light in deltas], np.int32),
        delta_position=_float32([row.position for row in delta_rows], (-1, 3)),
        delta_axes=_float32([row.axes for row in delta_rows], (-1, 3, 3)),
        delta_color=_float32([row.color for row in delta_rows], (-1, 3)),
        delta_cutoff=_float32([row.cutoff for row in delta_rows], (-1,)),
        delta_number=_float32([_filled(row.numbers) for row in delta_rows], (-1, NUMBERS)),
        delta_texture=np.array([_texture_number(light, textures) for light in deltas], np.int32),
        environment_pixels=pixels,
        environment_axes=_float32(axes_of(environment[0].to_world) if environment else np.eye(3), (3, 3)),
        scene_radius=radius,
        medium=media.astype(np.int32),
        power=np.concatenate([np.asarray(power, np.float64).reshape(-1) for power in powers]),
        light=np.concatenate([emitter, len(emitters) + np.arange(len(others))]).astype(np.int32),
        names=(*(mesh.name for mesh in emitters), *(light.name for light in others)),
    )


def _check_strengths(lights: Sequence[DeltaLight], colors: Sequence[tuple[float, ...]]) -> None:
    """Raise SceneError if an intensity is beyond single precision where half the scene's longest side is the unit."""
    largest = float(np.finfo(np.float32).max)
    for light, color in zip(lights, colors, strict=True):
        if not max(color) <= largest:
            raise SceneError(
                f'light "{light.name}" is brighter than single precision holds: {max(color):.2g} divided by the square '
                f"of half the scene's size, and {largest:.2g} is the most; dim all lamps alike"
            )


def _only(environments: list[Environment]) -> list[Environment]:
    if len(environments) > 1:
        names = " and ".join(f'"{environment.name}"' for environment in environments)
        raise SceneError(f"a scene takes one environment, and it has {names}")
    for environment in environments:
        height, width = environment.pixels.shape[:2]
        if not environment.constant and min(height, width) < 2:
            raise SceneError(
                f'environment "{environment.name}": {width}x{height} pixels; 2x2 at least, or 1x1 for a constant one'
            )
    return environments


def _pixels(environment: Sequence[Environment]) -> NDArray[np.float32]:
    if not environment:
        return np.zeros((0, 0, 3), np.float32)
    return np.ascontiguousarray(environment[0].pixels, np.float32)


def _float32(values: object, shape: tuple[int, ...]) -> NDArray[np.float32]:
    return np.array(values, np.float64).reshape(shape).astype(np.float32)


def _filled(numbers: tuple[float, ...]) -> tuple[float, ...]:
    return (*numbers, *(0.0 for _ in range(NUMBERS - len(numbers))))


def _factor(mesh: Solid, texture: int) -> tuple[float, ...]:
    """Radiance of a glowing mesh, or the factor of its texture."""
    return (1.0, 1.0, 1.0) if texture >= 0 or not isinstance(mesh.emission, tuple) else mesh.emission


def _texture_number(light: DeltaLight, textures: Sequence[Texture]) -> int:
    if light.texture is None:
        return -1
    for number, texture in enumerate(textures):
        if texture is light.texture:
            return number
    raise SceneError(f'{light.KIND.name} light "{light.name}": its texture is not among those of the scene')


def _facing_front(
    triangles: Triangles, rows: NDArray[np.intp]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Corners, uvs and colours of triangles, wound so that their normals agree with their vertex normals."""
    corners, uvs = triangles.positions[rows].copy(), triangles.uvs[rows].copy()
    colors = triangles.colors[rows].copy() if len(triangles.colors) else triangles.colors
    p = corners.astype(np.float64)
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    against = np.einsum("ij,ij->i", normal, triangles.normals[rows].sum(axis=1, dtype=np.float64)) < 0
    for values in (corners, uvs, colors):
        if len(values):
            values[against] = values[against][:, [0, 2, 1]]
    return corners, uvs, colors


def _triangle_power(
    corners: NDArray[np.float32],
    uvs: NDArray[np.float32],
    colors: NDArray[np.float32],
    emitter: NDArray[np.int32],
    radiance: NDArray[np.float32],
    emitter_texture: NDArray[np.int32],
    textures: Sequence[Texture],
) -> NDArray[np.float64]:
    """Flux of glowing triangles, shape [E]."""
    mean = radiance.mean(axis=1, dtype=np.float64)[emitter] if len(emitter) else np.zeros(0)
    for number in np.flatnonzero(np.asarray(emitter_texture) >= 0):
        own = np.flatnonzero(emitter == number)
        texture = textures[emitter_texture[number]]
        mean[own] *= triangle_means(texture, uvs[own], colors[own] if len(colors) else colors)
    return math.pi * triangle_areas(corners) * mean


class _Enclosure:
    """Which medium a place is in: that of the side on which a ray from it meets the nearest boundary.

    Outside of all boundaries it is the camera's, if that is there too: in a room full of fog often only the camera
    names the fog, and photons of a lamp that is in none would fly through it as through air.
    """

    # Any direction serves; one without symmetry meets no edge or plane of a modelled scene by chance.
    _DIRECTION = np.array([0.36371, 0.81649, 0.44833])

    def __init__(self, triangles: Triangles, sides: NDArray[np.int32] | None, camera: Camera | None) -> None:
        rows = np.flatnonzero((sides >= NO_MEDIUM).any(axis=1)) if sides is not None else np.zeros(0, np.intp)
        self._corners = _facing_front(triangles, rows)[0].astype(np.float64)
        self._sides = sides[rows] if sides is not None else np.zeros((0, 2), np.int32)
        self._outside = NO_MEDIUM
        if camera is not None and camera.medium is not None and self._side_at(camera.to_world[:3, 3]) is None:
            self._outside = camera.medium

    @property
    def everywhere(self) -> int | None:
        """The medium of all places, where there is no boundary; else None."""
        return None if len(self._corners) else self._outside

    def medium_at(self, place: NDArray[np.floating]) -> int:
        """The medium at a place, which may be NO_MEDIUM."""
        found = self._side_at(place)
        return self._outside if found is None else found

    def _side_at(self, place: NDArray[np.floating]) -> int | None:
        """That of a boundary's side that a ray meets; None without one. Möller & Trumbore's test against all."""
        p0 = self._corners[:, 0]
        e1, e2 = self._corners[:, 1] - p0, self._corners[:, 2] - p0
        across = np.cross(self._DIRECTION, e2)
        determinant = np.einsum("ij,ij->i", e1, across)
        hit = determinant != 0.0
        inverse = np.divide(1.0, determinant, out=np.zeros_like(determinant), where=hit)
        arm = np.asarray(place, np.float64) - p0
        other = np.cross(arm, e1)
        u, v = np.einsum("ij,ij->i", arm, across) * inverse, (other @ self._DIRECTION) * inverse
        t = np.einsum("ij,ij->i", e2, other) * inverse
        hit &= (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0)
        if not hit.any():
            return None
        nearest = int(np.argmin(np.where(hit, t, np.inf)))
        behind = determinant[nearest] < 0.0  # the ray leaves through the front: it was behind
        return int(self._sides[nearest, 0 if behind else 1])


ASKED_OF_A_LAMP = 64
"""Triangles of a glowing mesh, spread over it, whose medium is looked for; all, where these are not in the same one."""


def _mesh_media(mesh: Solid, corners: NDArray[np.float32], inside: _Enclosure) -> NDArray[np.int32]:
    """The medium before each triangle of a glowing mesh: the mesh's own, or what the triangle's middle is in."""
    if mesh.bounds or mesh.exterior is not None:
        return np.full(len(corners), NO_MEDIUM if mesh.exterior is None else mesh.exterior, np.int32)
    if inside.everywhere is not None:
        return np.full(len(corners), inside.everywhere, np.int32)
    some = range(0, len(corners), max(1, len(corners) // ASKED_OF_A_LAMP))
    found = [_medium_before(corners[number], inside) for number in some]
    if len(set(found)) > 1:
        found = [_medium_before(triangle, inside) for triangle in corners]
    return np.full(len(corners), found[0] if len(set(found)) == 1 else found, np.int32)


def _medium_before(corners: NDArray[np.float32], inside: _Enclosure) -> int:
    """That at a point before a triangle's middle, as its normal points."""
    p = corners.astype(np.float64)
    normal = np.cross(p[1] - p[0], p[2] - p[0])
    lift = 1e-4 * math.sqrt(float(np.linalg.norm(normal)))  # of the triangle's size
    return inside.medium_at((p.mean(axis=0) + normal / np.linalg.norm(normal) * lift).astype(np.float32))


def _medium(light: Light, inside: _Enclosure) -> int:
    if light.at is None:
        return NO_MEDIUM
    return inside.medium_at(light.at.astype(np.float32)) if light.medium is None else light.medium
