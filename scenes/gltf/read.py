"""Reads glTF 2.0 scenes (.gltf and .glb): triangles, nodes, materials, emission, cameras and lights.

Format: Khronos Group, "glTF 2.0 Specification", and the extensions KHR_lights_punctual,
KHR_materials_emissive_strength and KHR_texture_transform. Lengths are metres. Photometric values are taken over as they
are: one candela becomes one W/sr and one nit one W/(m² sr), so emissive surfaces and lights keep their ratio, and the
picture is in candelas per square metre; likewise one lux of a directional light becomes one W/m².
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.gltf.animation import Poses
from wdpm.scenes.gltf.container import GltfFile
from wdpm.scenes.gltf.draco import DRACO, decompress
from wdpm.scenes.gltf.instancing import INSTANCING, places_of, rotations
from wdpm.scenes.gltf.lights import read_gltf_camera, read_gltf_light
from wdpm.scenes.gltf.materials import COLOR_ATTRIBUTE, MATERIAL_EXTENSIONS, GltfMaterial, GltfMaterials
from wdpm.scenes.gltf.textures import WEBP, Images, images_of, read_image
from wdpm.scenes.images.ahead import Ahead
from wdpm.scenes.meshes.framing import Frame, completed_scene, refuse_frame
from wdpm.scenes.meshes.mesh_data import MeshData
from wdpm.scenes.meshes.several import available_cores
from wdpm.scenes.model.lights import Light
from wdpm.scenes.model.scene import Camera, Instance, Medium, Mesh, Scene, Solid
from wdpm.scenes.model.textures import RGB
from wdpm.scenes.model.transforms import Matrix, mirrors
from wdpm.scenes.model.viewpoint import named_camera

VARIANTS = "KHR_materials_variants"
_EXTENSIONS = MATERIAL_EXTENSIONS | {
    "KHR_lights_punctual",
    "KHR_texture_transform",
    "KHR_mesh_quantization",
    INSTANCING,
    DRACO,
    WEBP,
    VARIANTS,
}
MESHOPT = "EXT_meshopt_compression"
_TRIANGLES, _STRIP, _FAN = 4, 5, 6


def read_gltf(
    file: Path,
    size: tuple[int, int] | None = None,
    *,
    camera: str | None = None,
    frame: Frame | None = None,
    time: float | None = None,
) -> Scene:
    """Reads the file's default scene. What it lacks, camera or light, is added as for a bare mesh.

    Args:
        size: width and height in pixels; by default 512 high with the camera's aspect ratio.
        camera: name of the camera to look through; None for the first.
        frame: from where a scene without a camera is seen.
        time: of its animations, in seconds; None for the nodes as they stand without.

    Raises:
        SceneError: broken or truncated, or in need of an extension or a kind of light that is not supported.
    """
    gltf = GltfFile(file)
    with Ahead(partial(read_image, gltf), images_of(gltf), available_cores()) as images:
        return _Reader(gltf, time, images).read(size, camera, frame)


class _Reader:
    def __init__(self, gltf: GltfFile, time: float | None, images: Images) -> None:
        self.gltf = gltf
        self.warnings: list[str] = []
        self.poses = Poses(gltf, time, self.warnings)
        self.materials = GltfMaterials(gltf, self.warnings, images)
        self.meshes: list[Solid] = []
        self._shapes: dict[int, Mesh | None] = {}
        self._uses: Counter[object] = Counter()
        self.lights: list[Light] = []
        self.media: list[Medium] = []
        self.cameras: list[tuple[str, dict[str, Any], Matrix]] = []

    def read(self, size: tuple[int, int] | None, wanted: str | None, frame: Frame | None) -> Scene:
        self._check_extensions()
        nodes = list(self._nodes())
        self._uses = Counter(node["mesh"] for _, node, _ in nodes if isinstance(node.get("mesh"), int))
        for name, node, to_world in nodes:
            self._read_node(name, node, to_world)
        name = self.gltf.file.stem
        materials = [entry.material for entry in self.materials.materials]
        if not self.meshes:
            raise self.gltf.error("the scene is empty: it has no triangles")
        if self.lights:
            self.warnings.append(
                "lights: 1 candela is taken as 1 W/sr and 1 lux as 1 W/m², "
                "like 1 nit of emissive surfaces as 1 W/(m² sr)"
            )
        if not self.cameras and wanted is not None:
            named_camera(wanted, [], self.gltf.file)
        if self.cameras:
            refuse_frame(frame, self.gltf.file)
        camera = self._read_camera(size, wanted) if self.cameras else None
        scene = completed_scene(
            name, self.meshes, materials, self.lights, camera, size=size, warnings=self.warnings, frame=frame
        )
        # Lights of its own may be as bright as the sun or as a candle: glTF says nothing of exposure.
        return replace(scene, media=tuple(self.media), exposure=None if self.lights else 0.0)

    def _check_extensions(self) -> None:
        required = self.gltf.get(self.gltf.json, "extensionsRequired", list, [])
        missing = [str(name) for name in required if name not in _EXTENSIONS]
        if MESHOPT in missing:
            raise self.gltf.error(
                f"its buffers are compressed by {MESHOPT}, which is not read: unpack them first, as "
                f"`gltf-transform copy {self.gltf.file.name} unpacked.glb` does"
            )
        if VARIANTS in self.gltf.get(self.gltf.json, "extensionsUsed", list, []):
            self.warnings.append("variants of materials: each surface has the one that the file gives without a choice")
        if missing:
            raise self.gltf.error(f"needs extensions that are not supported: {', '.join(missing)}")
        # those of materials are told of with the material, if a surface has it
        used = self.gltf.get(self.gltf.json, "extensionsUsed", list, [])
        unread = [str(name) for name in used if name not in _EXTENSIONS and "_materials_" not in str(name)]
        if unread:
            self.warnings.append(f"extensions that are not read, with what they say left out: {', '.join(unread)}")

    def _nodes(self) -> Iterator[tuple[str, dict[str, Any], Matrix]]:
        """All nodes of the default scene with their transform to world space."""
        stack: list[tuple[Any, Matrix]] = [(root, np.eye(4)) for root in reversed(self._roots())]
        visited: set[int] = set()
        while stack:
            index, parent = stack.pop()
            node = self.gltf.item("nodes", index)
            if index in visited:
                raise self.gltf.error(f"broken glTF: nodes[{index}] has two parents or is its own ancestor")
            visited.add(index)
            to_world = parent @ self._local(self.poses.posed(node, index), index)
            yield self.gltf.get(node, "name", str, f"node {index}"), node, to_world
            children = self.gltf.get(node, "children", list, [])
            stack.extend((child, to_world) for child in reversed(children))

    def _roots(self) -> list[Any]:
        if self.gltf.count("scenes"):
            return list(self.gltf.get(self.gltf.item("scenes", self.gltf.json.get("scene", 0)), "nodes", list, []))
        nodes = [self.gltf.item("nodes", index) for index in range(self.gltf.count("nodes"))]
        children = {
            child for node in nodes for child in self.gltf.get(node, "children", list, []) if isinstance(child, int)
        }
        return [index for index in range(len(nodes)) if index not in children]

    def _local(self, node: dict[str, Any], index: Any) -> Matrix:
        if "matrix" in node:
            matrix = np.array(self.gltf.numbers(node, "matrix", [0.0] * 16)).reshape(4, 4).T  # columns first
            if not np.array_equal(matrix[3], [0.0, 0.0, 0.0, 1.0]):
                raise self.gltf.error(f"broken glTF: nodes[{index}].matrix is not affine")
            return matrix
        x, y, z, w = self.gltf.numbers(node, "rotation", [0.0, 0.0, 0.0, 1.0])
        length = math.sqrt(x * x + y * y + z * z + w * w)
        if not length > 0:
            raise self.gltf.error(f"broken glTF: nodes[{index}].rotation is zero")
        matrix = np.eye(4)
        matrix[:3, :3] = rotations(np.array([[x, y, z, w]]) / length)[0]
        matrix[:3, :3] *= np.array(self.gltf.numbers(node, "scale", [1.0, 1.0, 1.0]))
        matrix[:3, 3] = self.gltf.numbers(node, "translation", [0.0, 0.0, 0.0])
        return matrix

    def _read_node(self, name: str, node: dict[str, Any], to_world: Matrix) -> None:
        if "mesh" in node:
            mesh = self.gltf.item("meshes", node["mesh"])
            if "skin" in node:
                self._warn_once(f'mesh "{name}": skinning is ignored, it stands as modelled')
            places = places_of(self.gltf, node, name, to_world)
            shared = places is not None or self._uses[node["mesh"]] > 1
            for primitive in self.gltf.get(mesh, "primitives", list, []):
                if not isinstance(primitive, dict):
                    raise self.gltf.error("broken glTF: a primitive is not an object")
                shape = self._shape(name, primitive, shared)
                if shape is not None:
                    self.meshes += [self._stand(name, shape, place, shared) for place in places or [to_world]]
        if "camera" in node:
            self.cameras.append((name, self.gltf.item("cameras", node["camera"]), to_world))
        extensions = self.gltf.get(node, "extensions", dict, {})
        if "KHR_lights_punctual" in extensions:
            index = self.gltf.get(extensions, "KHR_lights_punctual", dict, {}).get("light")
            self.lights.append(read_gltf_light(self.gltf, name, index, to_world, self.warnings))

    def _warn_once(self, message: str) -> None:
        if message not in self.warnings:
            self.warnings.append(message)

    def _shape(self, name: str, primitive: dict[str, Any], shared: bool) -> Mesh | None:
        """A primitive in its mesh's own space; read once if several nodes share the mesh."""
        if id(primitive) in self._shapes:
            return self._shapes[id(primitive)]
        shape = self._read_primitive(name, primitive)
        if shared:
            self._shapes[id(primitive)] = shape
        return shape

    def _stand(self, name: str, shape: Mesh, to_world: Matrix, shared: bool) -> Solid:
        """A primitive in world space."""
        if shared and np.linalg.matrix_rank(to_world[:3, :3]) == 3:
            return Instance(name, shape, to_world)
        data = self._placed(MeshData(shape.vertices, shape.faces, shape.normals, shape.uvs), to_world, name)
        return replace(shape, name=name, vertices=data.vertices, faces=data.faces, normals=data.normals)

    def _read_primitive(self, name: str, primitive: dict[str, Any]) -> Mesh | None:
        mode = self.gltf.get(primitive, "mode", int, _TRIANGLES)
        if mode in (0, 1, 2, 3):
            self._warn_once(f'mesh "{name}": points and lines are ignored')
            return None
        attributes = self.gltf.get(primitive, "attributes", dict, {})
        if "POSITION" not in attributes:
            self._warn_once(f'mesh "{name}": a primitive without positions is ignored')
            return None
        if "targets" in primitive:
            self._warn_once(f'mesh "{name}": morph targets are ignored')
        decompress(self.gltf, primitive)
        number = self.materials.read(primitive.get("material"), colored=COLOR_ATTRIBUTE in attributes)
        entry = self.materials.materials[number]
        vertices = self.gltf.converted(attributes["POSITION"], np.float64)
        if vertices.shape[1] != 3:
            raise self.gltf.error(f"broken glTF: POSITION has {vertices.shape[1]} components, expected 3")
        faces = self._faces(primitive, mode, len(vertices), name)
        normals = self._attribute(attributes, "NORMAL", 3, len(vertices))
        uvs = self._attribute(attributes, f"TEXCOORD_{entry.uv_set}", 2, len(vertices))
        colors = None
        if entry.vertex_tint is not None:
            colors = self._colors(attributes, entry.vertex_tint, len(vertices), name, opaque=entry.opaque)
        mesh = Mesh(name, vertices, faces, normals, uvs, number, entry.emission, colors)
        return mesh if entry.medium is None else replace(mesh, interior=self._medium(entry), bounds=True)

    def _medium(self, entry: GltfMaterial) -> int:
        """The number of the medium behind the surfaces of a material."""
        if entry.medium is None:
            raise AssertionError("asked for a material without one")
        if entry.medium not in self.media:
            self.media.append(entry.medium)
        return self.media.index(entry.medium)

    def _placed(self, data: MeshData, to_world: Matrix, name: str) -> MeshData:
        try:
            moved = data.transformed(to_world)
        except ValueError as error:
            raise self.gltf.error(f'node "{name}": {error}') from error
        # glTF wants the front kept when a node mirrors; MeshData keeps it only where normals say which side it is
        mirrored = mirrors(to_world)
        return moved.flipped() if mirrored and data.normals is None else moved

    def _colors(
        self, attributes: dict[str, Any], tint: RGB, count: int, name: str, *, opaque: bool
    ) -> NDArray[np.float64]:
        """Vertex colours times their material's base colour; a fourth component, of opacity, is ignored.

        Args:
            opaque: whether the material takes no notice of opacity, as glTF wants it by default.
        """
        values = self.gltf.converted(attributes[COLOR_ATTRIBUTE], np.float64)
        if values.shape[1] not in (3, 4) or len(values) != count:
            raise self.gltf.error(
                f"broken glTF: {COLOR_ATTRIBUTE} has shape {values.shape}, expected ({count}, 3 or 4)"
            )
        if not opaque and values.shape[1] == 4 and values[:, 3].min(initial=1.0) < 1.0:
            self._warn_once(f'mesh "{name}": the opacity in its {COLOR_ATTRIBUTE} is ignored')
        if not (values.min(initial=0.0) >= 0.0 and values.max(initial=0.0) <= 1.0):
            self._warn_once(f"{COLOR_ATTRIBUTE}: values outside 0 to 1 are clamped")
        return np.clip(values[:, :3], 0.0, 1.0) * np.array(tint)

    def _attribute(self, attributes: dict[str, Any], key: str, width: int, count: int) -> NDArray[np.float64] | None:
        if key not in attributes:
            return None
        values = self.gltf.converted(attributes[key], np.float64)
        if values.shape[1] != width or len(values) != count:
            raise self.gltf.error(f"broken glTF: {key} has shape {values.shape}, expected ({count}, {width})")
        return values

    def _faces(self, primitive: dict[str, Any], mode: int, vertex_count: int, name: str) -> NDArray[np.int64]:
        if "indices" in primitive:
            indices = self.gltf.converted(primitive["indices"], np.int64).reshape(-1)
        else:
            indices = np.arange(vertex_count)
        if len(indices) and not 0 <= indices.min() <= indices.max() < vertex_count:
            raise self.gltf.error(f'mesh "{name}": an index is out of range (there are {vertex_count} vertices)')
        if mode == _TRIANGLES:
            if len(indices) % 3:
                raise self.gltf.error(f'mesh "{name}": {len(indices)} indices do not make whole triangles')
            return indices.reshape(-1, 3)
        if mode in (_STRIP, _FAN) and len(indices) < 3:
            return np.zeros((0, 3), dtype=np.int64)
        if mode == _STRIP:
            strip = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
            strip[1::2] = strip[1::2, [1, 0, 2]]  # every other triangle of a strip is the other way round
            return strip
        if mode == _FAN:
            return np.stack([np.full(len(indices) - 2, indices[0]), indices[1:-1], indices[2:]], axis=1)
        raise self.gltf.error(f'mesh "{name}": primitives of mode {mode} do not exist')

    def _read_camera(self, size: tuple[int, int] | None, wanted: str | None) -> Camera:
        names = [name for name, _, _ in self.cameras]
        if wanted is not None:
            self.warnings.append(f'--camera: it looks through "{wanted}"')
        elif len(names) > 1:
            others = ", ".join(f'"{name}"' for name in names[1:])
            self.warnings.append(f'the file has {len(names)} cameras: "{names[0]}" is used; --camera NAME for {others}')
        name, camera, to_world = self.cameras[0 if wanted is None else named_camera(wanted, names, self.gltf.file)]
        return read_gltf_camera(self.gltf, name, camera, to_world, size)
