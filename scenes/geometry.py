"""A scene as flat arrays: what kernels read and what travels to slaves.

Triangles carry their own vertices (a soup): a cell then holds just what it owns, a leaf's triangles lie one after
another in memory, and no index can point outside a partition.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.framing import bounding_box
from wdpm.scenes.model import RGB, Bitmap, Camera, Material, Mesh, Scene
from wdpm.scenes.transforms import normalized, translation


@dataclass(frozen=True, eq=False)
class Triangles:
    """Triangles in the renderer's space (the scene's centre at the origin), sorted by their global number.

    Attributes:
        ids: global triangle numbers, int32, shape [T], strictly ascending.
        positions: float32, shape [T, 3, 3] (triangle, corner, axis).
        normals: unit shading normals at the corners, float32, shape [T, 3, 3]; a zero row where the mesh is flat.
        uvs: texture coordinates at the corners, float32, shape [T, 3, 2].
        material: index of the material, int32, shape [T].
        emitter: index of the emitter's radiance, int32, shape [T]; -1 where nothing is emitted.
    """

    ids: NDArray[np.int32]
    positions: NDArray[np.float32]
    normals: NDArray[np.float32]
    uvs: NDArray[np.float32]
    material: NDArray[np.int32]
    emitter: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.ids)

    def take(self, rows: NDArray[np.intp]) -> Triangles:
        """Some of the triangles; rows ascending."""
        return Triangles(
            self.ids[rows],
            self.positions[rows],
            self.normals[rows],
            self.uvs[rows],
            self.material[rows],
            self.emitter[rows],
        )


@dataclass(frozen=True, eq=False)
class FlatScene:
    """A scene as arrays, in the renderer's space: moved so that the middle of its bounding box is the origin.

    Attributes:
        triangles: numbered in the order of the meshes, without the dropped ones.
        reflectance: albedo of each material, linear RGB, float32, shape [M, 3]; 1 where it has a texture.
        texture: index of each material's texture, int32, shape [M]; -1 for none.
        twosided: whether the back reflects too, shape [M].
        textures: each bitmap once.
        emitter_radiance: of each glowing mesh, linear RGB [W/(m² sr)], float32, shape [E, 3].
        point_position: point lights, float32, shape [P, 3].
        point_intensity: linear RGB [W/sr], float32, shape [P, 3].
        light_names: of the E emitters, then of the P point lights.
        camera: moved like the scene.
        center: what was subtracted from the scene's coordinates, float64, shape [3].
        extent: largest absolute coordinate of any vertex, point light or the camera.
        dropped: number of triangles left out, by cause.
    """

    triangles: Triangles
    reflectance: NDArray[np.float32]
    texture: NDArray[np.int32]
    twosided: NDArray[np.bool_]
    textures: tuple[Bitmap, ...]
    emitter_radiance: NDArray[np.float32]
    point_position: NDArray[np.float32]
    point_intensity: NDArray[np.float32]
    light_names: tuple[str, ...]
    camera: Camera
    center: NDArray[np.float64]
    extent: float
    dropped: dict[str, int]


NON_FINITE, ZERO_AREA, NO_NORMAL = "not finite", "zero area", "no normal in single precision"


def flatten(scene: Scene) -> FlatScene:
    """Turns a scene into arrays.

    Coordinates are moved in double precision before they are rounded, so a model far from the origin keeps its detail.

    Raises:
        SceneError: an index out of range, or no triangle is left.
    """
    low, high = bounding_box(scene.meshes)
    center = (low + high) / 2.0
    emitters = [mesh for mesh in scene.meshes if _glows(mesh)]
    emitter_index = {id(mesh): index for index, mesh in enumerate(emitters)}
    parts = [_soup(mesh, center, len(scene.materials), emitter_index.get(id(mesh), -1)) for mesh in scene.meshes]
    triangles, dropped = _without_degenerate(_joined(parts))
    if len(triangles) == 0:
        raise SceneError(f"no triangle of the scene can be rendered: {_listed(dropped)}")
    camera = replace(scene.camera, to_world=translation(-center) @ scene.camera.to_world)
    points = np.array([light.position for light in scene.point_lights]).reshape(-1, 3) - center
    textures, texture = _textures(scene.materials)
    others = np.concatenate([points.ravel(), camera.to_world[:3, 3]])
    return FlatScene(
        triangles,
        np.array([_flat_reflectance(m) for m in scene.materials], dtype=np.float32).reshape(-1, 3),
        texture,
        np.array([material.twosided for material in scene.materials], dtype=np.bool_),
        textures,
        np.array([mesh.emission for mesh in emitters], dtype=np.float32).reshape(-1, 3),
        points.astype(np.float32),
        np.array([light.intensity for light in scene.point_lights], dtype=np.float32).reshape(-1, 3),
        (*(mesh.name for mesh in emitters), *(light.name for light in scene.point_lights)),
        camera,
        center,
        max(float(np.abs(triangles.positions).max()), float(np.abs(others).max())),
        dropped,
    )


def _glows(mesh: Mesh) -> bool:
    return mesh.emission is not None and max(mesh.emission) > 0 and len(mesh.faces) > 0


def _flat_reflectance(material: Material) -> RGB:
    return (1.0, 1.0, 1.0) if isinstance(material.reflectance, Bitmap) else material.reflectance


def _textures(materials: Sequence[Material]) -> tuple[tuple[Bitmap, ...], NDArray[np.int32]]:
    found: dict[int, int] = {}
    bitmaps: list[Bitmap] = []
    texture = np.full(len(materials), -1, dtype=np.int32)
    for row, material in enumerate(materials):
        if isinstance(material.reflectance, Bitmap):
            if id(material.reflectance) not in found:
                found[id(material.reflectance)] = len(bitmaps)
                bitmaps.append(material.reflectance)
            texture[row] = found[id(material.reflectance)]
    return tuple(bitmaps), texture


def _soup(mesh: Mesh, center: NDArray[np.float64], material_count: int, emitter: int) -> Triangles:
    """A mesh's triangles with their own corners; ids are given later."""
    count = len(mesh.faces)
    if count and not (mesh.faces.min() >= 0 and mesh.faces.max() < len(mesh.vertices)):
        raise SceneError(f'mesh "{mesh.name}": a face names a vertex out of range (there are {len(mesh.vertices)})')
    if not 0 <= mesh.material < material_count:
        raise SceneError(f'mesh "{mesh.name}": there is no material {mesh.material} (there are {material_count})')
    with np.errstate(over="ignore"):  # beyond single precision: becomes infinite and is dropped as such
        positions = (mesh.vertices - center).astype(np.float32)[mesh.faces]
    return Triangles(
        np.zeros(count, dtype=np.int32),
        positions,
        _corner_normals(mesh),
        np.zeros((count, 3, 2), dtype=np.float32) if mesh.uvs is None else mesh.uvs.astype(np.float32)[mesh.faces],
        np.full(count, mesh.material, dtype=np.int32),
        np.full(count, emitter, dtype=np.int32),
    )


def _corner_normals(mesh: Mesh) -> NDArray[np.float32]:
    if mesh.normals is None:
        return np.zeros((len(mesh.faces), 3, 3), dtype=np.float32)
    normals = normalized(mesh.normals).astype(np.float32)[mesh.faces]
    # a normal that is missing at one corner cannot be interpolated: the triangle is flat
    normals[~np.any(normals != 0, axis=2).all(axis=1)] = 0.0
    return normals


def _joined(parts: Sequence[Triangles]) -> Triangles:
    names = [attribute.name for attribute in fields(Triangles)]
    return Triangles(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def _without_degenerate(soup: Triangles) -> tuple[Triangles, dict[str, int]]:
    """Drops triangles that have no area and numbers the others."""
    cause = _degenerate_cause(soup.positions)
    dropped = {
        name: int(np.sum(cause == code)) for code, name in enumerate((NON_FINITE, ZERO_AREA, NO_NORMAL), start=1)
    }
    kept = soup if not cause.any() else soup.take(np.flatnonzero(cause == 0))
    numbered = replace(kept, ids=np.arange(len(kept), dtype=np.int32))
    return numbered, {name: count for name, count in dropped.items() if count}


def _degenerate_cause(positions: NDArray[np.float32]) -> NDArray[np.int8]:
    """Why triangles are dropped, shape [T]: 0 not, 1 not finite, 2 zero area, 3 no normal in single precision."""
    cause = np.zeros(len(positions), dtype=np.int8)
    with np.errstate(invalid="ignore", over="ignore", under="ignore"):
        cross = np.cross(positions[:, 1] - positions[:, 0], positions[:, 2] - positions[:, 0])
        square = np.sum(cross * cross, axis=1)
    # nearly all have a normal in single precision, and the exact test is needed for the rest only
    cause[~(np.isfinite(square) & (square > 0))] = 3
    doubtful = np.flatnonzero(cause)
    corners = positions[doubtful].astype(np.float64)
    finite = np.isfinite(corners).all(axis=(1, 2))
    with np.errstate(invalid="ignore"):
        exact = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    cause[doubtful[finite & ~exact.any(axis=1)]] = 2
    cause[doubtful[~finite]] = 1
    return cause


def _listed(dropped: dict[str, int]) -> str:
    return ", ".join(f"{count} dropped ({name})" for name, count in dropped.items())
