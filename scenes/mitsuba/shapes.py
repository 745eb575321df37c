"""Mitsuba's shape plugins as meshes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from wdpm.scenes.meshes import primitives
from wdpm.scenes.meshes.creases import creased
from wdpm.scenes.meshes.large_spheres import RoundShape
from wdpm.scenes.meshes.mesh_data import MeshData
from wdpm.scenes.meshes.obj import read_obj
from wdpm.scenes.meshes.obj_file import ObjFile
from wdpm.scenes.meshes.ply import read_ply
from wdpm.scenes.mitsuba.plugin import Plugin
from wdpm.scenes.mitsuba.serialized import read_serialized
from wdpm.scenes.model import transforms
from wdpm.scenes.model.transforms import Matrix


class ShapeReader:
    """Turns shape plugins into meshes; a file that several shapes use is read once.

    Args:
        spheres: how many the scene has.
        warnings: grows by what is mended.

    Attributes:
        around: segments of curved shapes.
        spheres: those that were read.
    """

    def __init__(self, spheres: int = 0, warnings: list[str] | None = None) -> None:
        self.around = primitives.segments_around(spheres)
        self.spheres: list[RoundShape] = []
        self._warnings = [] if warnings is None else warnings
        self._files: dict[tuple[Path, int], MeshData] = {}
        self._objs: dict[Path, ObjFile] = {}

    def read(self, plugin: Plugin, *, emits: bool = False) -> MeshData:
        """The shape in world space, facing the way Mitsuba's does.

        Takes all parameters that belong to the geometry; bsdf, emitter and media are left.

        Args:
            emits: whether it glows: then its area is that of the round shape.
        """
        plugin.ignore("silhouette_sampling_weight")  # of derivatives, which nobody takes here
        from_file = plugin.type in ("obj", "ply", "serialized")
        if plugin.type == "sphere":
            return self._read_sphere(plugin, emits)
        mesh = self._read_file(plugin) if from_file else _read_primitive(plugin, self.around, emits)
        flat = from_file and plugin.take_bool("face_normals", False)
        if from_file and not flat and mesh.has_placeholder_normals():
            self._warnings.append(f"{plugin}: all its vertex normals are the same, and wrong: new ones are computed")
            mesh = mesh.flat()
        if flat:
            mesh = mesh.flat()
        mesh = self._creased(plugin, mesh, flat=flat) if from_file else mesh
        to_world = plugin.take_transform("to_world")
        if to_world is not None:
            mesh = _transformed(mesh, to_world, plugin)
        if not flat:
            # Mitsuba computes normals for every mesh that lacks them, in world space, unless it is told to be flat
            mesh = mesh.smooth()
        return mesh.flipped() if plugin.take_bool("flip_normals", False) else mesh

    def _read_sphere(self, plugin: Plugin, emits: bool) -> MeshData:
        centre, radius = plugin.take_point("center", (0.0, 0.0, 0.0)), plugin.take_positive("radius", 1.0)
        matrix = transforms.translation(centre) @ transforms.scaling([radius] * 3)
        to_world = plugin.take_transform("to_world")
        flips = plugin.take_bool("flip_normals", False)

        def placed(unit: MeshData) -> MeshData:
            mesh = unit.transformed(matrix)
            if to_world is not None:
                mesh = _transformed(mesh, to_world, plugin)
                if transforms.mirrors(to_world):
                    mesh = mesh.flipped()  # Mitsuba turns a mirrored sphere inside out, and no other shape
            return mesh.flipped() if flips else mesh

        mesh = placed(primitives.sphere(self.around, true_area=emits))
        self.spheres.append(RoundShape(mesh.vertices, matrix if to_world is None else to_world @ matrix, placed))
        return mesh

    def read_obj_file(self, file: Path) -> ObjFile:
        """An OBJ file with its materials' names."""
        if file not in self._objs:
            self._objs[file] = read_obj(file)
        return self._objs[file]

    def _creased(self, plugin: Plugin, mesh: MeshData, *, flat: bool) -> MeshData:
        """The mesh with 0.6's `maxSmoothAngle`, if it is given."""
        if not plugin.has("max_smooth_angle"):
            return mesh
        at = plugin.at("max_smooth_angle")
        angle = plugin.take_float("max_smooth_angle", 180.0)
        if flat or not 0.0 <= angle <= 180.0:
            raise at.error(
                f'{plugin}: "max_smooth_angle" must lie between 0 and 180 degrees, and face_normals not be set'
            )
        return creased(mesh, angle)

    def _read_file(self, plugin: Plugin) -> MeshData:
        file = plugin.take_file()
        index = plugin.take_int("shape_index", 0) if plugin.type == "serialized" else 0
        key = file.resolve(), index
        if key not in self._files:
            self._files[key] = self._load(plugin, file, index)
        mesh = self._files[key]
        # Mitsuba's images begin at the top with v = 0, OBJ files' at the bottom: hence the default
        if plugin.take_bool("flip_tex_coords", plugin.type == "obj") and mesh.uvs is not None:
            mesh = replace(mesh, uvs=mesh.uvs * (1.0, -1.0) + (0.0, 1.0))
        if plugin.type == "obj":
            plugin.ignore("collapse", "load_materials")  # 0.6; materials are always Mitsuba's own
        return mesh

    def _load(self, plugin: Plugin, file: Path, index: int) -> MeshData:
        match plugin.type:
            case "obj":
                return self.read_obj_file(file).mesh
            case "ply":
                return read_ply(file)
        return read_serialized(file, index)


def _transformed(mesh: MeshData, matrix: Matrix, plugin: Plugin) -> MeshData:
    try:
        return mesh.transformed(matrix)
    except ValueError as error:
        raise plugin.at("to_world").error(f'{plugin}: "to_world": {error}') from error


def _read_primitive(plugin: Plugin, around: int, true_area: bool) -> MeshData:
    match plugin.type:
        case "rectangle":
            return primitives.rectangle()
        case "cube":
            return primitives.cube()
        case "disk":
            return primitives.disk(around, true_area=true_area)
        case "cylinder":
            return _read_cylinder(plugin, primitives.cylinder(around, true_area=true_area))
    raise AssertionError(plugin.type)  # the tables of supported plugins and this match disagree


def _read_cylinder(plugin: Plugin, unit: MeshData) -> MeshData:
    start = np.array(plugin.take_point("p0", (0.0, 0.0, 0.0)))
    axis = np.array(plugin.take_point("p1", (0.0, 0.0, 1.0))) - start
    radius = plugin.take_positive("radius", 1.0)
    length = float(np.linalg.norm(axis))
    if not length > 0:
        raise plugin.error(f"{plugin}: p0 and p1 are the same point")
    frame = np.eye(4)
    frame[:3, 0], frame[:3, 1] = _coordinate_system(axis / length)
    frame[:3, 2] = axis / length
    matrix = transforms.translation(start) @ frame @ transforms.scaling([radius, radius, length])
    return unit.transformed(matrix)


def _coordinate_system(n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two vectors that complete n to a right-handed frame: those that Mitsuba takes, so that u begins where its does.

    "Building an Orthonormal Basis, Revisited", Duff et al. 2017.
    """
    sign = np.copysign(1.0, n[2])
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    return (
        np.array([n[0] * n[0] * a * sign + 1.0, b * sign, -n[0] * sign]),
        np.array([b, n[1] * n[1] * a + sign, -n[1]]),
    )
