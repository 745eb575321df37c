"""Meshes and scenes of trimesh as scenes: what people have in memory, without a file between.

Colours become diffuse reflectance. Those of vertices, of faces and of images are for the screen (sRGB); factors of
materials are linear, as in the files that trimesh writes. Vertex normals are used where its exporters would write them:
where they were given, or asked for (`mesh.vertex_normals`) since the mesh last changed. Other meshes are flat.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.images.read import linear_pixels
from wdpm.scenes.meshes.framing import completed_scene
from wdpm.scenes.meshes.in_memory import Meshes
from wdpm.scenes.meshes.mesh_data import MeshData, VertexAttribute
from wdpm.scenes.meshes.vertex_attributes import VERTEX_COLOR, screen_colors
from wdpm.scenes.model.bsdfs import GREY
from wdpm.scenes.model.checks import check_mesh
from wdpm.scenes.model.lights import DirectionalLight, Light, PointLight, SpotLight
from wdpm.scenes.model.scene import Camera, Material, Mesh, Scene, diffuse, horizontal_fov
from wdpm.scenes.model.textures import RGB, Bitmap, Color, VertexColors
from wdpm.scenes.model.transforms import Matrix, facing_forward, mirrors

FAR = 1e10  # scene units: a camera of trimesh is never to cut off what is before it
NEAR = 1e-4  # of the distance from the camera to the middle of what it sees


def read_trimesh(source: Meshes, size: tuple[int, int] | None = None) -> Scene:
    """The scene that trimesh's objects make; what it lacks, camera or light, is added as for a bare mesh file.

    One candela of trimesh's lights is taken as 1 W/sr and one lux as 1 W/m², as in glTF files. A camera keeps its
    vertical field of view; its clip planes are not used, since they mostly are trimesh's defaults.

    Args:
        size: width and height in pixels; by default the camera's resolution, else 512x512.

    Raises:
        SceneError: no triangles, values that are not finite, or a transform that flattens space.
    """
    reader = _Reader()
    if isinstance(source, trimesh.Scene):
        reader.read_scene(source, size)
    else:
        each = [source] if isinstance(source, trimesh.Trimesh) else source
        for number, mesh in enumerate(each):
            reader.add(_name_of(mesh, f"mesh {number}"), mesh, None)
    if not reader.meshes:
        raise SceneError("trimesh: the scene is empty: it has no triangles")
    for found in reader.meshes:  # where a camera has to stand is worked out from them
        check_mesh(found, len(reader.materials), None)
    return completed_scene(
        "trimesh",
        reader.meshes,
        reader.materials,
        reader.lights,
        reader.camera,
        size=size,
        warnings=reader.warnings,
        place="the scene",
    )


class _Reader:
    """What was found so far."""

    def __init__(self) -> None:
        self.meshes: list[Mesh] = []
        self.materials: list[Material] = []
        self.lights: list[Light] = []
        self.camera: Camera | None = None
        self.warnings: list[str] = []

    def read_scene(self, scene: Any, size: tuple[int, int] | None) -> None:
        """A scene's nodes, in the order of its graph, then its lights and its camera, if somebody has set them."""
        for node in scene.graph.nodes_geometry:
            to_world, name = scene.graph[node]
            geometry = scene.geometry[name]
            if isinstance(geometry, trimesh.Trimesh):
                self.add(str(node), geometry, np.asarray(to_world, np.float64))
            else:
                self._warn(f'"{name}": a {type(geometry).__name__} has no surface and is ignored')
        if not self.meshes:
            return
        # Its properties would invent both.
        for light in getattr(scene, "_lights", None) or ():
            self.lights.append(_light(light, np.asarray(scene.graph[light.name][0], np.float64)))
        if self.lights:
            self._warn("lights: 1 candela is taken as 1 W/sr and 1 lux as 1 W/m²")
        if scene.has_camera:
            self.camera = _camera(scene, self.meshes, size)

    def add(self, name: str, mesh: Any, to_world: Matrix | None) -> None:
        """A mesh, put into the world."""
        if len(mesh.faces) == 0:
            self._warn(f'mesh "{name}": it has no triangles and is ignored')
            return
        data = _placed(_data(mesh), to_world, name)
        material, emission, colors = self._looks(name, mesh, data)
        self.meshes.append(
            Mesh(name, data.vertices, data.faces, data.normals, data.uvs, len(self.materials), emission, colors)
        )
        self.materials.append(material)

    def _looks(self, name: str, mesh: Any, data: MeshData) -> tuple[Material, Color | None, NDArray[np.float64] | None]:
        """A mesh's material, what it emits, and the colours of its vertices."""
        if mesh.visual.kind == "texture":
            reflectance, emission = self._material(name, mesh.visual.material, data.uvs is not None)
            return diffuse(name, reflectance, twosided=True), emission, None
        colors = screen_colors(data)
        return diffuse(name, GREY if colors is None else VertexColors(VERTEX_COLOR), twosided=True), None, colors

    def _material(self, name: str, material: Any, has_uvs: bool) -> tuple[Color, RGB | None]:
        """Reflectance and emission of a material of trimesh: an image times a factor, or one colour."""
        if isinstance(material, trimesh.visual.material.PBRMaterial):
            return self._base_color(name, material, has_uvs), _emission(material)
        if not isinstance(material, trimesh.visual.material.SimpleMaterial):
            self._warn(f'mesh "{name}": a {type(material).__name__} is not supported: grey is used')
            return GREY, None
        factor = _factor(material.diffuse)
        if material.image is None or not has_uvs:
            return factor, None
        # Trimesh's own grey stands for "no colour given", beside an image.
        default = trimesh.visual.color.to_rgba(None)
        tint = (1.0, 1.0, 1.0) if np.array_equal(material.diffuse, default) else factor
        return _bitmap(name, material.image, tint), None

    def _base_color(self, name: str, material: Any, has_uvs: bool) -> Color:
        if material.metallicFactor not in (None, 0.0) or material.metallicRoughnessTexture is not None:
            self._warn(f'mesh "{name}": it is taken for diffuse; export a .glb to keep metal and roughness')
        if material.emissiveTexture is not None or material.normalTexture is not None:
            self._warn(f'mesh "{name}": its textures of emission and normals are ignored')
        given = material.baseColorFactor
        factor = (1.0, 1.0, 1.0) if given is None else _factor(given)
        if material.baseColorTexture is None or not has_uvs:
            return factor
        return _bitmap(name, material.baseColorTexture, factor)

    def _warn(self, message: str) -> None:
        if message not in self.warnings:
            self.warnings.append(f"trimesh: {message}")


def _name_of(mesh: Any, fallback: str) -> str:
    return str(mesh.metadata.get("name") or fallback)


def _data(mesh: Any) -> MeshData:
    """A mesh's arrays; with colours of faces, each face has vertices of its own."""
    vertices = np.asarray(mesh.vertices, np.float64)
    faces = np.asarray(mesh.faces, np.int64)
    normals = np.asarray(mesh.vertex_normals, np.float64) if "vertex_normals" in mesh._cache else None
    if mesh.visual.kind == "texture":
        uv = mesh.visual.uv
        usable = uv is not None and len(uv) == len(vertices)
        return MeshData(vertices, faces, normals, np.asarray(uv, np.float64)[:, :2] if usable else None)
    if mesh.visual.kind is None:
        return MeshData(vertices, faces, normals)
    if mesh.visual.kind == "face":
        corners = faces.reshape(-1)
        normals = None if normals is None else normals[corners]
        colors = np.repeat(mesh.visual.face_colors, 3, axis=0)
        vertices, faces = vertices[corners], np.arange(len(corners), dtype=np.int64).reshape(-1, 3)
    else:
        colors = mesh.visual.vertex_colors
    shares = np.asarray(colors, np.float64)[:, :3] / 255
    return MeshData(vertices, faces, normals, None, {VERTEX_COLOR: VertexAttribute(shares, coded=True)})


def _placed(data: MeshData, to_world: Matrix | None, name: str) -> MeshData:
    """In the world; a mirroring transform keeps the front in front, as trimesh's own `apply_transform` does."""
    if to_world is None or np.array_equal(to_world, np.eye(4)):
        return data
    try:
        moved = data.transformed(to_world)
    except ValueError as error:
        raise SceneError(f'trimesh: node "{name}": {error}') from error
    mirrored = mirrors(to_world)
    return moved.flipped() if mirrored and data.normals is None else moved


def _factor(color: Any) -> RGB:
    """A factor of a material, linear, from 8 bits or floats."""
    red, green, blue = trimesh.visual.color.to_float(np.asarray(color)).reshape(-1)[:3].tolist()
    return red, green, blue


def _emission(material: Any) -> RGB | None:
    given = material.emissiveFactor
    if given is None or not np.max(given) > 0:
        return None
    red, green, blue = np.asarray(given, np.float64).reshape(-1)[:3].tolist()
    return red, green, blue


def _bitmap(name: str, image: Any, factor: RGB) -> Bitmap:
    """A Pillow image as a texture; its first row is at v = 1, as in OBJ files."""
    pixels = linear_pixels(np.asarray(image.convert("RGB")), f'trimesh: the image of mesh "{name}"')
    return Bitmap(name, pixels if factor == (1.0, 1.0, 1.0) else pixels * np.array(factor, np.float32))


def _camera(scene: Any, meshes: Sequence[Mesh], size: tuple[int, int] | None) -> Camera:
    """A scene's camera. It has square pixels, whatever its horizontal field of view says."""
    camera = scene.camera
    width, height = size or (int(camera.resolution[0]), int(camera.resolution[1]))
    to_world = facing_forward(np.asarray(scene.camera_transform, np.float64))
    middle = np.mean([mesh.vertices.mean(axis=0) for mesh in meshes], axis=0)
    distance = float(np.linalg.norm(middle - to_world[:3, 3])) or 1.0
    fov_x = horizontal_fov(float(camera.fov[1]), "y", width / height)
    return Camera(to_world, fov_x, width, height, near_clip=NEAR * distance, far_clip=FAR)


def _light(light: Any, to_world: Matrix) -> Light:
    """A light; colours of lights are linear."""
    red, green, blue = (light.intensity * np.asarray(light.color, np.float64)[:3] / 255).tolist()
    if isinstance(light, trimesh.scene.lighting.PointLight):
        x, y, z = to_world[:3, 3].tolist()
        return PointLight(light.name, (x, y, z), (red, green, blue))
    matrix = facing_forward(to_world)
    if isinstance(light, trimesh.scene.lighting.SpotLight):
        outer, inner = math.degrees(light.outerConeAngle), math.degrees(light.innerConeAngle)
        return SpotLight(light.name, matrix, (red, green, blue), outer, inner, squared=True)
    x, y, z = matrix[:3, 2].tolist()
    return DirectionalLight(light.name, (x, y, z), (red, green, blue))
