"""Bare mesh files as scenes: with their own colours or materials or grey, lit and framed so that something is seen."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.beside import file_beside
from wdpm.scenes.meshes.framing import Frame, framed_scene
from wdpm.scenes.meshes.mesh_data import MeshData, VertexAttribute
from wdpm.scenes.meshes.mtl import MtlMaterial, read_mtl
from wdpm.scenes.meshes.obj import read_obj, uncolored_vertex
from wdpm.scenes.meshes.obj_file import ObjFile
from wdpm.scenes.meshes.off import has_colored_faces, read_off
from wdpm.scenes.meshes.ply import read_ply
from wdpm.scenes.meshes.stl import read_stl
from wdpm.scenes.meshes.vertex_attributes import VERTEX_COLOR, screen_colors
from wdpm.scenes.model.scene import Material, Mesh, Scene, diffuse
from wdpm.scenes.model.textures import RGB, Color, VertexColors

GREY = diffuse("grey", twosided=True)
# what a model calls its lamps; only where nothing else in it glows
LAMP_NAMES = frozenset(("lamp", "light", "emitter"))
LAMP_RADIANCE: RGB = (10.0, 10.0, 10.0)
COLORED = diffuse("vertex colours", VertexColors(VERTEX_COLOR), twosided=True)


def read_stand_alone(file: Path, size: tuple[int, int] | None = None, frame: Frame | None = None) -> Scene:
    """Reads an OBJ, PLY, STL or OFF file. Vertex normals and colours are used where the file has them.

    Args:
        size: width and height in pixels.
        frame: from where it is seen; None for from inside where it is a closed room.

    Raises:
        SceneError: the file is broken.
    """
    if file.suffix.lower() == ".obj":
        return _read_obj_scene(file, size, frame)
    read = {".ply": read_ply, ".stl": read_stl, ".off": read_off}[file.suffix.lower()]
    warnings: list[str] = []
    mesh, material = _colored(file.stem, read(file), 0, file, warnings)
    if read is read_off and has_colored_faces(file):
        warnings.append(f"{file.name}: colours of faces are ignored; those of vertices are read (COFF)")
    return framed_scene(file.stem, [mesh], [material], size=size, warnings=warnings, frame=frame)


def _placed(name: str, mesh: MeshData, material: int, emission: Color | None = None) -> Mesh:
    return Mesh(name, mesh.vertices, mesh.faces, mesh.normals, mesh.uvs, material, emission)


def _colored(name: str, data: MeshData, material: int, file: Path, warnings: list[str]) -> tuple[Mesh, Material]:
    """A mesh that has no material: in the colours of its vertices, or grey."""
    colors = screen_colors(data)
    unusable = f"{file.name}: colours of vertices beyond 0 to 1, or that are no numbers, are ignored: grey is used"
    if colors is None and VERTEX_COLOR in data.attributes and unusable not in warnings:
        warnings.append(unusable)
    mesh = Mesh(name, data.vertices, data.faces, data.normals, data.uvs, material, colors=colors)
    return mesh, GREY if colors is None else COLORED


def _read_obj_scene(file: Path, size: tuple[int, int] | None, frame: Frame | None) -> Scene:
    obj = read_obj(file)
    warnings = list(obj.warnings)
    library = _read_libraries(obj, file, warnings)
    library |= _read_own_library(obj, file, library, warnings)
    lit = any(name in library and library[name].emission is not None for name in obj.materials)
    materials: list[Material] = []
    meshes: list[Mesh] = []
    colorable = False  # whether any mesh would have the colours of its vertices
    for number, name in enumerate(obj.materials):
        part = part_of(obj, number)
        entry = library.get(name)
        if entry is not None:
            mesh, material = _placed(name or file.stem, part, number, entry.emission), entry.material
        elif name.lower() in LAMP_NAMES and not lit:
            mesh, material = _placed(name, part, number, LAMP_RADIANCE), GREY
            warnings.append(f'{file.name}: material "{name}" is in no library: by its name it is taken for a lamp')
        else:
            mesh, material = _colored(name or file.stem, part, number, file, warnings)
            colorable = True
            if name:
                instead = "grey is" if mesh.colors is None else "the colours of its vertices are"
                warnings.append(f'{file.name}: material "{name}" is in no library: {instead} used')
        meshes.append(mesh)
        materials.append(material)
    if colorable and obj.partly_colored:
        warnings.append(
            f"{file.name}:{uncolored_vertex(file)}: not every vertex has a colour, and this one has none: "
            "the colours of all are ignored"
        )
    return framed_scene(file.stem, meshes, materials, size=size, warnings=warnings, frame=frame)


def part_of(obj: ObjFile, material: int) -> MeshData:
    """The triangles of one material, with the vertices that they use."""
    mesh = obj.mesh
    if len(obj.materials) == 1:  # every vertex is a corner of some triangle
        return mesh
    faces = mesh.faces[obj.face_material == material]
    used, renumbered = _renumbered(faces, len(mesh.vertices))
    attributes = {name: VertexAttribute(a.values[used], a.coded) for name, a in mesh.attributes.items()}
    return MeshData(
        mesh.vertices[used],
        renumbered,
        None if mesh.normals is None else mesh.normals[used],
        None if mesh.uvs is None else mesh.uvs[used],
        attributes,
    )


def _renumbered(faces: NDArray[np.int64], count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The vertices that faces use, ascending, and the faces by their places among these."""
    if 8 * faces.size < count:  # many small parts: not all vertices for each
        used, renumbered = np.unique(faces, return_inverse=True)
        return used, renumbered.reshape(-1, 3)
    is_used = np.zeros(count, np.bool_)
    is_used[faces] = True
    number = np.cumsum(is_used) - 1
    return np.flatnonzero(is_used), number[faces]


def _read_own_library(
    obj: ObjFile, file: Path, known: Mapping[str, MtlMaterial], warnings: list[str]
) -> dict[str, MtlMaterial]:
    """Materials that the libraries lack, from the one of the model's own name, which the file may not mention."""
    missing = {name for name in obj.materials if name and name not in known}
    own = next((own for own in _own_libraries(file) if own.is_file()), None)
    if not missing or own is None:
        return {}
    notes: list[str] = []
    found = {name: entry for name, entry in read_mtl(own, notes).items() if name in missing}
    for name in found:
        warnings.append(f'{file.name}: material "{name}" is in no library that the file names: {own.name} has it')
        warnings.extend(note for note in notes if f'material "{name}"' in note)
    return found


def _own_libraries(file: Path) -> tuple[Path, Path]:
    """The library that a model would have, also if that is a link."""
    return file.with_suffix(".mtl"), Path(os.path.realpath(file)).with_suffix(".mtl")


def _read_libraries(obj: ObjFile, file: Path, warnings: list[str]) -> dict[str, MtlMaterial]:
    found: dict[str, MtlMaterial] = {}
    for name, line in obj.libraries:
        named = name.replace("\\", "/")
        # exporters write paths of their own machine; the library then mostly lies beside the model
        wanted = [file_beside(file, each) for each in (named, Path(named).name)]
        library = next((path for path in wanted if path.is_file()), None)
        if library is None:
            warnings.append(f'{file.name}:{line}: material library "{name}" not found: grey is used')
        else:
            found.update(read_mtl(library, warnings))
    return found
