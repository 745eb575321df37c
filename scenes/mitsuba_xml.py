"""Reads Mitsuba 3 scene files; the spellings of Mitsuba 0.6 are accepted.

Format: Mitsuba 3 documentation, "Scene XML file format". What is not supported yet is an error that names file and
line; what cannot change the image is ignored, and what might is listed in Scene.warnings.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from wdpm.scenes.framing import framing_camera
from wdpm.scenes.mesh_data import MeshData
from wdpm.scenes.mitsuba_materials import MaterialReader
from wdpm.scenes.mitsuba_params import OBJECT_TAGS, VALUE_TAGS, Plugin, unknown_tag
from wdpm.scenes.mitsuba_sensor import Size, read_integrator, read_sensor
from wdpm.scenes.mitsuba_shapes import ShapeReader
from wdpm.scenes.model import RGB, Bitmap, Camera, Mesh, PointLight, Scene
from wdpm.scenes.xml_document import Document, Element, read_document


def read_mitsuba(file: Path, defines: Mapping[str, str], size: Size | None = None) -> Scene:
    """Reads a scene file.

    Args:
        defines: values of the file's `$name` parameters.
        size: width and height in pixels that replace the film's.

    Raises:
        SceneError: with file and line.
    """
    return _SceneReader(read_document(file, defines), file).read(size)


class _SceneReader:
    def __init__(self, document: Document, file: Path) -> None:
        self.document = document
        self.file = file
        self.warnings: list[str] = []
        self.materials = MaterialReader(self.warnings)
        self.shapes = ShapeReader()
        self.meshes: list[Mesh] = []
        self.lights: list[PointLight] = []
        self.sensors: list[Plugin] = []
        self.integrators: list[Plugin] = []

    def read(self, size: Size | None) -> Scene:
        for element in self.document.root.children:
            self._read_top_level(element)
        max_depth = None
        for integrator in self.integrators[:1]:
            max_depth = read_integrator(integrator, self.warnings)
        for extra in self.integrators[1:]:
            raise extra.error("the scene has more than one integrator")
        camera, samples = self._camera(size)
        return Scene(
            self.file.parent.name if self.file.stem == "scene" else self.file.stem,
            tuple(self.meshes),
            tuple(self.materials.materials),
            tuple(self.lights),
            camera,
            samples,
            max_depth,
            tuple(self.warnings),
        )

    def _read_top_level(self, element: Element) -> None:
        if element.tag == "ref":
            element = self.document.referenced(element)
        match element.tag:
            case "shape":
                self._read_shape(Plugin(element, self.document))
            case "emitter":
                self._read_emitter(Plugin(element, self.document))
            case "sensor":
                self.sensors.append(Plugin(element, self.document))
            case "integrator":
                self.integrators.append(Plugin(element, self.document))
            case "bsdf" | "texture" if "id" in element.attributes:
                pass  # read when a shape refers to it, so what no shape uses may be unsupported
            case "bsdf" | "texture":
                self.warnings.append(f"line {element.line}: <{element.tag}> without id: nothing can use it")
            case "medium" | "phase" | "volume" | "subsurface":
                raise element.error(f"<{element.tag}> is not supported yet")
            case tag if tag in VALUE_TAGS | OBJECT_TAGS:
                raise element.error(f"<{tag}> does not belong directly into <scene>")
            case _:
                raise unknown_tag(element)

    def _read_shape(self, plugin: Plugin) -> None:
        mesh = self.shapes.read(plugin)
        emitter = plugin.take_one("emitter")
        emission = None if emitter is None else _read_area_light(emitter)
        material = self.materials.read(plugin.take_one("bsdf"), emits=emitter is not None)
        plugin.finish()
        self._warn_without_uvs(plugin, mesh, material)
        self.meshes.append(Mesh(plugin.name, mesh.vertices, mesh.faces, mesh.normals, mesh.uvs, material, emission))

    def _warn_without_uvs(self, plugin: Plugin, mesh: MeshData, material: int) -> None:
        if mesh.uvs is None and isinstance(self.materials.materials[material].reflectance, Bitmap):
            self.warnings.append(f"shape {plugin.name} has a texture but no texture coordinates: (0, 0) is used")

    def _read_emitter(self, plugin: Plugin) -> None:
        if plugin.type == "area":
            raise plugin.error('emitter "area" must be nested in a shape')
        to_world = plugin.take_transform("to_world")
        if to_world is not None and plugin.has("position"):
            raise plugin.value_error("position", "and to_world cannot both be given")
        position = plugin.take_point("position", (0.0, 0.0, 0.0))
        if to_world is not None:
            position = float(to_world[0, 3]), float(to_world[1, 3]), float(to_world[2, 3])
        intensity = _read_emission(plugin, "intensity")
        plugin.ignore("sampling_weight")  # lights are chosen by power
        plugin.finish()
        self.lights.append(PointLight(plugin.name, position, intensity))

    def _camera(self, size: Size | None) -> tuple[Camera, int | None]:
        if not self.sensors:
            self.warnings.append("the scene has no sensor: the camera frames its bounding box")
            return framing_camera(self.meshes, size), None
        for other in self.sensors[1:]:
            self.warnings.append(
                f"the scene has {len(self.sensors)} sensors: {other.name} is ignored, the first is used"
            )
        return read_sensor(self.sensors[0], size, self.warnings)


def _read_area_light(plugin: Plugin) -> RGB:
    if plugin.type != "area":
        raise plugin.error(f'a shape takes an emitter "area", not "{plugin.type}"')
    # before 0.6 it was called intensity
    radiance = _read_emission(plugin, "intensity" if plugin.has("intensity") else "radiance")
    plugin.ignore("sampling_weight")
    plugin.finish()
    return radiance


def _read_emission(plugin: Plugin, name: str) -> RGB:
    for texture in plugin.take_nested("texture", name):
        raise texture.error(f'{plugin}: a texture as "{name}" is not supported yet; give an <rgb>')
    error = plugin.value_error(name, "must not be negative")
    value = plugin.take_colour(name, (1.0, 1.0, 1.0), emission=True)
    if min(value) < 0:
        raise error
    return value
