"""Reads Mitsuba 3 scene files; the spellings of Mitsuba 0.6 are accepted.

Format: Mitsuba 3 documentation, "Scene XML file format". What is not supported yet is an error that names file and
line; what cannot change the image is ignored, and what might is listed in Scene.warnings.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.images.ahead import Ahead
from wdpm.scenes.meshes.framing import Frame, added_camera, refuse_frame
from wdpm.scenes.meshes.large_spheres import with_finer_spheres
from wdpm.scenes.meshes.mesh_data import MeshData
from wdpm.scenes.meshes.several import available_cores
from wdpm.scenes.meshes.vertex_attributes import with_colors
from wdpm.scenes.mitsuba.document import Document, Element, read_document
from wdpm.scenes.mitsuba.emitters import EmitterReader
from wdpm.scenes.mitsuba.groups import GroupReader
from wdpm.scenes.mitsuba.materials import MaterialReader
from wdpm.scenes.mitsuba.media import MediaReader, Sides
from wdpm.scenes.mitsuba.named_materials import parts_of, take_named_bsdfs
from wdpm.scenes.mitsuba.plugin import OBJECT_TAGS, VALUE_TAGS, Plugin, left_out, unknown_tag
from wdpm.scenes.mitsuba.sensor import Size, read_integrator, read_sensor
from wdpm.scenes.mitsuba.shapes import ShapeReader
from wdpm.scenes.mitsuba.textures import Pictures, pictures_of, read_picture
from wdpm.scenes.mitsuba.upgrade import upgrade, version_of
from wdpm.scenes.model.bsdfs import (
    uses_uvs,
    vertex_attributes,
)
from wdpm.scenes.model.checks import check_reach
from wdpm.scenes.model.lights import Light
from wdpm.scenes.model.scene import Camera, Mesh, Scene, Solid
from wdpm.scenes.model.textures import Bitmap, Checkerboard, Color
from wdpm.scenes.model.viewpoint import named_camera

_PARTS = {"bsdf", "texture", "medium", "phase", "volume", "sampler", "film", "rfilter"}
"""What is nested in other plugins, and stands in the scene itself only to be referred to."""


def read_mitsuba(
    file: Path,
    defines: Mapping[str, str],
    size: Size | None = None,
    *,
    lenient: bool = False,
    camera: str | None = None,
    frame: Frame | None = None,
) -> Scene:
    """Reads a scene file.

    Args:
        defines: values of the file's `$name` parameters.
        size: width and height in pixels that replace the film's.
        lenient: whether the nearest known thing may stand in for what is not known (rules).
        camera: id of the sensor to look through; None for the first.
        frame: from where a scene without a sensor is seen.

    Raises:
        SceneError: with file and line.
    """
    document = read_document(file, defines)
    document.rules.lenient = lenient
    upgrade(document)
    with Ahead(read_picture, pictures_of(document), available_cores()) as pictures:
        return _SceneReader(document, file, pictures).read(size, camera, frame)


class _SceneReader:
    def __init__(self, document: Document, file: Path, pictures: Pictures) -> None:
        self.document = document
        self.file = file
        self.warnings = document.rules.warnings
        self.materials = MaterialReader(self.warnings, pictures)
        self.media = MediaReader(self.warnings, old=_is_old(document))
        self.emitters = EmitterReader(
            self.materials.textures, self.media, old_axes=_is_old(document), warnings=self.warnings
        )
        self.shapes = ShapeReader(_count_spheres(document), self.warnings)
        self.groups = GroupReader(self._read_meshes)
        self.meshes: list[Solid] = []
        self.unplaced: list[Plugin] = []  # groups, which stand where instances say
        self.lights: list[Light] = []
        self.sensors: list[Plugin] = []
        self.integrators: list[Plugin] = []

    def read(self, size: Size | None, wanted: str | None, frame: Frame | None) -> Scene:
        for element in self.document.root.children:
            self._read_top_level(element)
        if not self.meshes and self.unplaced:
            raise self.unplaced[0].error(
                'the scene is empty: no <shape type="instance"> puts what this group holds into it'
            )
        max_depth = None
        for integrator in self.integrators[:1]:
            max_depth = read_integrator(integrator, self.warnings)
        for extra in self.integrators[1:]:
            raise extra.error("the scene has more than one integrator")
        camera, samples, exposure = self._camera(size, wanted, frame)
        return Scene(
            self.file.parent.name if self.file.stem == "scene" else self.file.stem,
            tuple(with_finer_spheres(self.meshes, self.shapes.spheres, self.shapes.around)),
            tuple(self.materials.materials),
            tuple(self.lights),
            camera,
            samples,
            max_depth,
            tuple(self.warnings),
            tuple(self.media.media),
            exposure,
        )

    def _read_top_level(self, element: Element) -> None:
        if element.tag == "ref":
            element = self.document.referenced(element)
        match element.tag:
            case "shape" | "emitter" if left_out(element, self.document):
                pass
            case "shape":
                self._read_shape(Plugin(element, self.document))
            case "emitter" if element.attributes.get("type") == "area" and "id" in element.attributes:
                pass  # read when a shape refers to it
            case "emitter":
                self.lights.append(self.emitters.read(Plugin(element, self.document)))
            case "sensor":
                self.sensors.append(Plugin(element, self.document))
            case "integrator":
                self.integrators.append(Plugin(element, self.document))
            case tag if tag in _PARTS and "id" in element.attributes:
                pass  # read when a shape refers to it, so what no shape uses may be unsupported
            case tag if tag in _PARTS:
                self.warnings.append(f"line {element.line}: <{element.tag}> without id: nothing can use it")
            case "subsurface":
                what = f"<{element.tag}> is not supported yet"
                self.document.rules.refuse(element.error(what), what, "it is left out")
            case tag if tag in VALUE_TAGS and element.attributes.get("name") in ("blockSize", "block_size"):
                self.document.rules.tell(element.line, f"<{tag}>: the size of blocks is ignored")  # 0.6's
            case tag if tag in VALUE_TAGS | OBJECT_TAGS:
                what = f"<{tag}> does not belong directly into <scene>"
                self.document.rules.refuse(element.error(what), what, "it is left out")
            case _:
                raise unknown_tag(element)

    def _read_shape(self, plugin: Plugin) -> None:
        if plugin.type == "instance":
            self.meshes += self.groups.read(plugin)
        elif plugin.type == "shapegroup":
            self.unplaced.append(plugin)
            if plugin.id is None:
                self.warnings.append(f"line {plugin.line}: {plugin} without id: nothing can use it")
        else:
            self.meshes += self._read_meshes(plugin)

    def _read_meshes(self, plugin: Plugin) -> list[Mesh]:
        """A shape that has triangles of its own: one mesh, or one for each material of its file."""
        emitter = plugin.take_one("emitter")
        emission = None if emitter is None else self.emitters.read_area(emitter)
        emits = emitter is not None
        by_material = take_named_bsdfs(plugin, old=_is_old(self.document))
        sides = self.media.read_sides(plugin)
        if by_material:
            at = plugin.at("filename")
            obj = self.shapes.read_obj_file(self.document.resolve_file(at.attribute("value"), at))
            mesh = self.shapes.read(plugin, emits=emits)
            parts = parts_of(plugin, mesh, obj, by_material, self.materials, emits=emits)
        else:
            material = self.materials.read(plugin.take_one("bsdf"), emits=emits)
            mesh = self.shapes.read(plugin, emits=emits)
            parts = [(plugin.name, mesh, material)]
        plugin.finish()
        if sides.bounds:
            self.media.warn_if_open(plugin, mesh)
        return [self._mesh(plugin, name, part, material, emission, sides) for name, part, material in parts]

    def _mesh(
        self, plugin: Plugin, name: str, mesh: MeshData, material: int, emission: Color | None, sides: Sides
    ) -> Mesh:
        self._warn_without_uvs(plugin, mesh, material, emission)
        mesh, colors = self._with_colors(plugin, mesh, material, emission)
        made = Mesh(
            name,
            mesh.vertices,
            mesh.faces,
            mesh.normals,
            mesh.uvs,
            material,
            emission,
            colors,
            sides.inside,
            sides.outside,
            sides.bounds,
        )
        try:
            check_reach(made, None)
        except SceneError as error:
            raise plugin.error(str(error)) from error
        return made

    def _with_colors(
        self, plugin: Plugin, mesh: MeshData, material: int, emission: Color | None
    ) -> tuple[MeshData, NDArray[np.float64] | None]:
        try:
            return with_colors(mesh, vertex_attributes(self.materials.materials[material].bsdf, emission))
        except ValueError as error:
            raise plugin.error(f"shape {plugin.name}: {error}") from error

    def _warn_without_uvs(self, plugin: Plugin, mesh: MeshData, material: int, emission: Color | None) -> None:
        used = uses_uvs(self.materials.materials[material].bsdf) or isinstance(emission, Bitmap | Checkerboard)
        if mesh.uvs is None and used:
            self.warnings.append(f"shape {plugin.name} has a texture but no texture coordinates: (0, 0) is used")

    def _camera(
        self, size: Size | None, wanted: str | None, frame: Frame | None
    ) -> tuple[Camera, int | None, float | None]:
        """The camera, the samples that it asks for, and the exposure of its pictures."""
        names = [
            sensor.element.attributes.get("id", f"sensor {number}") for number, sensor in enumerate(self.sensors, 1)
        ]
        chosen = 0 if wanted is None else named_camera(wanted, names, self.file)
        if not self.sensors:
            if not self.meshes:
                raise SceneError("the scene is empty: it has no triangles", self.file)
            return added_camera(self.meshes, size, frame, self.warnings, "no sensor in the file"), None, 0.0
        refuse_frame(frame, self.file)
        if wanted is not None:
            self.warnings.append(f'--camera: it looks through "{wanted}"')
        elif len(names) > 1:
            others = ", ".join(f'"{name}"' for name in names[1:])
            self.warnings.append(
                f'the scene has {len(names)} sensors: "{names[0]}" is used; --camera NAME for {others}'
            )
        return read_sensor(self.sensors[chosen], size, self.media.read_around, self.warnings)


def _is_old(document: Document) -> bool:
    """Whether a file says that it is for a version before Mitsuba 1."""
    version = version_of(document)
    return version is not None and version[0] == 0


def _count_spheres(document: Document) -> int:
    """Of the scene and its groups, each counted once."""
    shapes = [element for element in document.root.children if element.tag == "shape"]
    groups = [shape for shape in shapes if shape.attributes.get("type") == "shapegroup"]
    shapes += [element for group in groups for element in group.children if element.tag == "shape"]
    return sum(shape.attributes.get("type") == "sphere" for shape in shapes)
