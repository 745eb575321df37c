"""Reads glTF 2.0 scenes (.gltf and .glb): triangles, nodes, materials, emission, cameras and lights.

Format: Khronos Group, "glTF 2.0 Specification", and the extensions KHR_lights_punctual,
KHR_materials_emissive_strength and KHR_texture_transform. Lengths are metres. Photometric values are taken over as they
are: one candela becomes one W/sr and one nit one W/(m² sr), so emissive surfaces and lights keep their ratio, and the
picture is in candelas per square metre; likewise one lux of a directional light becomes one W/m².
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.gltf.animation import Poses
from wdpm.scenes.gltf.container import GltfFile
from wdpm.scenes.gltf.deform import Deformation, deformation_of, morphed, skinned
from wdpm.scenes.gltf.draco import DRACO, decompress
from wdpm.scenes.gltf.instancing import INSTANCING, places_of
from wdpm.scenes.gltf.lights import read_gltf_camera, read_gltf_light
from wdpm.scenes.gltf.materials import COLOR_ATTRIBUTE, MATERIAL_EXTENSIONS, GltfMaterial, GltfMaterials
from wdpm.scenes.gltf.nodes import VISIBILITY, Node, nodes_of
from wdpm.scenes.gltf.textures import WEBP, Images, images_of, read_image
from wdpm.scenes.images.ahead import Ahead
from wdpm.scenes.meshes.backs import are_closed, back_of
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
    VISIBILITY,
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
        self._shapes: dict[tuple[int, tuple[float, ...]], list[Mesh]] = {}
        self._uses: Counter[object] = Counter()
        self.lights: list[Light] = []
        self.media: list[Medium] = []
        self.cameras: list[tuple[str, dict[str, Any], Matrix]] = []

    def read(self, size: tuple[int, int] | None, wanted: str | None, frame: Frame | None) -> Scene:
        self._check_extensions()
        nodes = list(nodes_of(self.gltf, self.poses))
        places = {node.index: node.to_world for node in nodes}
        self._uses = Counter(node.values["mesh"] for node in nodes if isinstance(node.values.get("mesh"), int))
        for node in nodes:
            self._read_node(node, places)
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

    def _read_node(self, node: Node, places: Mapping[int, Matrix]) -> None:
        if "camera" in node.values:
            self.cameras.append((node.name, self.gltf.item("cameras", node.values["camera"]), node.to_world))
        if not node.visible:
            return
        if "mesh" in node.values:
            self._read_mesh(node, places)
        extensions = self.gltf.get(node.values, "extensions", dict, {})
        if "KHR_lights_punctual" in extensions:
            index = self.gltf.get(extensions, "KHR_lights_punctual", dict, {}).get("light")
            self.lights.append(read_gltf_light(self.gltf, node.name, index, node.to_world, self.warnings))

    def _read_mesh(self, node: Node, places: Mapping[int, Matrix]) -> None:
        mesh = self.gltf.item("meshes", node.values["mesh"])
        deformation = deformation_of(self.gltf, node.values, mesh, places)
        if deformation.joints is not None:  # these say where it is
            self.meshes += self._read_shapes(node.name, mesh, deformation)
            return
        stands = places_of(self.gltf, node.values, node.name, node.to_world)
        shared = stands is not None or self._uses[node.values["mesh"]] > 1
        for shape in self._shapes_of(node, mesh, deformation, shared):
            self.meshes += [self._stand(node.name, shape, place, shared) for place in stands or [node.to_world]]

    def _warn_once(self, message: str) -> None:
        if message not in self.warnings:
            self.warnings.append(message)

    def _shapes_of(self, node: Node, mesh: dict[str, Any], deformation: Deformation, shared: bool) -> list[Mesh]:
        """A mesh in its own space; read once if several nodes share it."""
        key = node.values["mesh"], deformation.weights
        if key in self._shapes:
            return self._shapes[key]
        shapes = self._read_shapes(node.name, mesh, deformation)
        if shared:
            self._shapes[key] = shapes
        return shapes

    def _read_shapes(self, name: str, mesh: dict[str, Any], deformation: Deformation) -> list[Mesh]:
        """The primitives of a mesh, and the backs of those that glow to both sides where the mesh is open."""
        shapes = []
        for primitive in self.gltf.get(mesh, "primitives", list, []):
            if not isinstance(primitive, dict):
                raise self.gltf.error("broken glTF: a primitive is not an object")
            shape = self._read_primitive(name, primitive, deformation)
            if shape is not None:
                shapes.append(shape)
        glowing = [each for each in shapes if each.emission is not None and len(each.faces)]
        glowing = [each for each in glowing if self.materials.materials[each.material].double_sided]
        return [*shapes, *map(back_of, glowing)] if glowing and not are_closed(shapes) else shapes

    def _stand(self, name: str, shape: Mesh, to_world: Matrix, shared: bool) -> Solid:
        """A primitive in world space."""
        if shared and np.linalg.matrix_rank(to_world[:3, :3]) == 3:
            return Instance(name, shape, to_world)
        data = self._placed(MeshData(shape.vertices, shape.faces, shape.normals, shape.uvs), to_world, name)
        return replace(shape, name=name, vertices=data.vertices, faces=data.faces, normals=data.normals)

    def _read_primitive(self, name: str, primitive: dict[str, Any], deformation: Deformation) -> Mesh | None:
        mode = self.gltf.get(primitive, "mode", int, _TRIANGLES)
        if mode in (0, 1, 2, 3):
            self._warn_once(f'mesh "{name}": points and lines are ignored')
            return None
        attributes = self.gltf.get(primitive, "attributes", dict, {})
        if "POSITION" not in attributes:
            self._warn_once(f'mesh "{name}": a primitive without positions is ignored')
            return None
        decompress(self.gltf, primitive)
        number = self.materials.read(primitive.get("material"), colored=COLOR_ATTRIBUTE in attributes)
        entry = self.materials.materials[number]
        vertices = self.gltf.converted(attributes["POSITION"], np.float64)
        if vertices.shape[1] != 3:
            raise self.gltf.error(f"broken glTF: POSITION has {vertices.shape[1]} components, expected 3")
        faces = self._faces(primitive, mode, len(vertices), name)
        normals = self._attribute(attributes, "NORMAL", 3, len(vertices))
        vertices, normals = morphed(self.gltf, primitive, deformation.weights, vertices, normals)
        if deformation.joints is not None:
            vertices, normals, mirrored = skinned(self.gltf, attributes, deformation.joints, vertices, normals)
            faces = faces[:, ::-1] if mirrored else faces
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
