"""All lights of a scene as arrays: what kernels read and what travels to slaves.

A light is chosen element by element: each glowing triangle is one, and so is every other light. Elements are numbered
triangles first, then points, spots, directionals, environment. What needs a C library's sine or arc cosine is computed
here, once, by the master.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.flat.areas import triangle_areas
from wdpm.scenes.flat.light_power import environment_integral, spot_pattern_mean, spot_power, triangle_means
from wdpm.scenes.flat.material_table import NO_MEDIUM
from wdpm.scenes.model.lights import DirectionalLight, Environment, Light, PointLight, SpotLight
from wdpm.scenes.model.textures import Texture

if TYPE_CHECKING:
    from wdpm.scenes.flat.arrays import Triangles
    from wdpm.scenes.model.scene import Mesh

L = TypeVar("L", PointLight, SpotLight, DirectionalLight, Environment)

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
        point_position: float32, shape [P, 3].
        point_intensity: [W/sr], float32, shape [P, 3].
        spot_position: float32, shape [S, 3].
        spot_axes: rows are the light's x, y and z axes in the world; it shines along z. float32, shape [S, 3, 3].
        spot_intensity: on the axis [W/sr], float32, shape [S, 3].
        spot_cosines: of the half angles beyond which there is no light and up to which it is full, float32, [S, 2].
        spot_falloff: half angle beyond which there is no light [radians], and 1 / (that minus the full one), 0 where
            the edge is sharp; float32, shape [S, 2].
        spot_texture: index into the textures, -1 for none, int32, shape [S].
        spot_spread: tangent of the first half angle: what the texture spans; float32, shape [S].
        directional_direction: in which the light travels, unit, float32, shape [D, 3].
        directional_irradiance: across it [W/m²], float32, shape [D, 3].
        environment_pixels: as light_sources.Environment, float32, shape [H, W, 3]; [0, 0, 3] without one.
        environment_axes: rows are the local axes in the world, float32, shape [3, 3].
        scene_radius: of a sphere about the origin that holds all triangles, with RADIUS_MARGIN.
        medium: that each light's rays start in, -1 for none, int32, shape [lights].
        power: flux of each element, mean of RGB [W], float64, shape [elements].
        light: which light each element belongs to, int32, shape [elements].
        names: of the lights: glowing meshes, points, spots, directionals, environment.
    """

    emitter_radiance: NDArray[np.float32]
    emitter_texture: NDArray[np.int32]
    prim: NDArray[np.int32]
    corners: NDArray[np.float32]
    uvs: NDArray[np.float32]
    colors: NDArray[np.float32]
    emitter: NDArray[np.int32]
    point_position: NDArray[np.float32]
    point_intensity: NDArray[np.float32]
    spot_position: NDArray[np.float32]
    spot_axes: NDArray[np.float32]
    spot_intensity: NDArray[np.float32]
    spot_cosines: NDArray[np.float32]
    spot_falloff: NDArray[np.float32]
    spot_texture: NDArray[np.int32]
    spot_spread: NDArray[np.float32]
    directional_direction: NDArray[np.float32]
    directional_irradiance: NDArray[np.float32]
    environment_pixels: NDArray[np.float32]
    environment_axes: NDArray[np.float32]
    scene_radius: float
    medium: NDArray[np.int32]
    power: NDArray[np.float64]
    light: NDArray[np.int32]
    names: tuple[str, ...]


def tabulate_lights(
    emitters: Sequence[Mesh],
    triangles: Triangles,
    emitter_texture: NDArray[np.int32],
    textures: Sequence[Texture],
    lights: Sequence[Light],
    sides: NDArray[np.int32] | None = None,
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

    Raises:
        SceneError: more than one environment, one that is too small, or a spot's texture that is not in `textures`.
    """
    points, spots = _all(lights, PointLight), _all(lights, SpotLight)
    directionals, environment = _all(lights, DirectionalLight), _only(_all(lights, Environment))
    rows = np.flatnonzero(triangles.emitter >= 0)
    emitter = triangles.emitter[rows].astype(np.int32)
    corners, uvs, colors = _facing_front(triangles, rows)
    radiance = _float32([_factor(mesh, int(t)) for mesh, t in zip(emitters, emitter_texture, strict=True)], (-1, 3))
    spot_texture = np.array([_texture_number(spot, textures) for spot in spots], np.int32)
    radius = float(np.sqrt((triangles.positions.astype(np.float64) ** 2).sum(axis=2).max())) * RADIUS_MARGIN
    pixels = _pixels(environment)
    others: list[Light] = [*points, *spots, *directionals, *environment]
    powers = [
        _triangle_power(corners, uvs, colors, emitter, radiance, emitter_texture, textures),
        [4.0 * math.pi * _mean(point.intensity) for point in points],
        [_spot_power(spot) for spot in spots],
        [math.pi * radius**2 * _mean(sun.irradiance) for sun in directionals],
        [math.pi * radius**2 * environment_integral(pixels) for _ in environment],
    ]
    position = _float32([point.position for point in points], (-1, 3))
    spot_position = _float32([spot.to_world[:3, 3] for spot in spots], (-1, 3))
    inside = _Enclosure(triangles, sides)
    media = [
        *(_mesh_medium(mesh, corners[emitter == number], inside) for number, mesh in enumerate(emitters)),
        *(_medium(light.medium, at, inside) for light, at in zip(points, position, strict=True)),
        *(_medium(light.medium, at, inside) for light, at in zip(spots, spot_position, strict=True)),
        *(NO_MEDIUM for _ in (*directionals, *environment)),
    ]
    return LightTable(
        emitter_radiance=radiance,
        emitter_texture=np.asarray(emitter_texture, np.int32),
        prim=triangles.ids[rows].astype(np.int32),
        corners=corners,
        uvs=uvs,
        colors=colors,
        emitter=emitter,
        point_position=position,
        point_intensity=_float32([point.intensity for point in points], (-1, 3)),
        spot_position=spot_position,
        spot_axes=_float32([_axes(spot.to_world) for spot in spots], (-1, 3, 3)),
        spot_intensity=_float32([spot.intensity for spot in spots], (-1, 3)),
        spot_cosines=_float32([[math.cos(a) for a in _angles(spot)] for spot in spots], (-1, 2)),
        spot_falloff=_float32([_falloff(spot) for spot in spots], (-1, 2)),
        spot_texture=spot_texture,
        spot_spread=_float32([math.tan(_angles(spot)[0]) for spot in spots], (-1,)),
        directional_direction=_float32(
            [np.array(d.direction) / np.linalg.norm(d.direction) for d in directionals], (-1, 3)
        ),
        directional_irradiance=_float32([sun.irradiance for sun in directionals], (-1, 3)),
        environment_pixels=pixels,
        environment_axes=_float32(_axes(environment[0].to_world) if environment else np.eye(3), (3, 3)),
        scene_radius=radius,
        medium=np.array(media, np.int32),
        power=np.concatenate([np.asarray(power, np.float64).reshape(-1) for power in powers]),
        light=np.concatenate([emitter, len(emitters) + np.arange(len(others))]).astype(np.int32),
        names=(*(mesh.name for mesh in emitters), *(light.name for light in others)),
    )


def _all(lights: Sequence[Light], kind: type[L]) -> list[L]:
    return [light for light in lights if isinstance(light, kind)]


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


def _mean(rgb: Sequence[float]) -> float:
    return sum(rgb) / 3.0


def _factor(mesh: Mesh, texture: int) -> tuple[float, ...]:
    """Radiance of a glowing mesh, or the factor of its texture."""
    return (1.0, 1.0, 1.0) if texture >= 0 or not isinstance(mesh.emission, tuple) else mesh.emission


def _texture_number(spot: SpotLight, textures: Sequence[Texture]) -> int:
    if spot.texture is None:
        return -1
    for number, texture in enumerate(textures):
        if texture is spot.texture:
            return number
    raise SceneError(f'spot light "{spot.name}": its texture is not among those of the scene')


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


def _angles(spot: SpotLight) -> tuple[float, float]:
    """Half angles of no light and of full light, radians."""
    return math.radians(spot.cutoff_angle), math.radians(spot.beam_width)


def _falloff(spot: SpotLight) -> tuple[float, float]:
    cutoff, beam = _angles(spot)
    return cutoff, 1.0 / (cutoff - beam) if cutoff > beam else 0.0


def _spot_power(spot: SpotLight) -> float:
    cutoff, beam = _angles(spot)
    power = spot_power(_mean(spot.intensity), cutoff, beam)
    return power if spot.texture is None else power * spot_pattern_mean(spot.texture, cutoff)


def _axes(to_world: NDArray[np.float64]) -> NDArray[np.float64]:
    """Columns of the matrix' rotation, as rows."""
    columns = np.asarray(to_world, np.float64)[:3, :3]
    unit: NDArray[np.float64] = (columns / np.linalg.norm(columns, axis=0)).T
    return unit


class _Enclosure:
    """Which medium a place is in: that of the side on which a ray from it meets the nearest boundary."""

    # Any direction serves; one without symmetry meets no edge or plane of a modelled scene by chance.
    _DIRECTION = np.array([0.36371, 0.81649, 0.44833])

    def __init__(self, triangles: Triangles, sides: NDArray[np.int32] | None) -> None:
        rows = np.flatnonzero((sides >= NO_MEDIUM).any(axis=1)) if sides is not None else np.zeros(0, np.intp)
        self._corners = _facing_front(triangles, rows)[0].astype(np.float64)
        self._sides = sides[rows] if sides is not None else np.zeros((0, 2), np.int32)

    def medium_at(self, place: NDArray[np.float32]) -> int:
        """The medium at a place, NO_MEDIUM outside of all; Möller & Trumbore's test against every boundary."""
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
            return NO_MEDIUM
        nearest = int(np.argmin(np.where(hit, t, np.inf)))
        behind = determinant[nearest] < 0.0  # the ray leaves through the front: it was behind
        return int(self._sides[nearest, 0 if behind else 1])


def _mesh_medium(mesh: Mesh, corners: NDArray[np.float32], inside: _Enclosure) -> int:
    """The medium before a glowing mesh: its own, or what it is in, seen from a point before its first triangle."""
    if mesh.bounds or mesh.exterior is not None:
        return NO_MEDIUM if mesh.exterior is None else mesh.exterior
    if not len(corners):
        return NO_MEDIUM
    p = corners[0].astype(np.float64)
    normal = np.cross(p[1] - p[0], p[2] - p[0])
    lift = 1e-4 * math.sqrt(float(np.linalg.norm(normal)))  # of the triangle's size
    return inside.medium_at((p.mean(axis=0) + normal / np.linalg.norm(normal) * lift).astype(np.float32))


def _medium(own: int | None, place: NDArray[np.float32], inside: _Enclosure) -> int:
    return inside.medium_at(place) if own is None else own
