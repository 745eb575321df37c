"""Bare mesh files as scenes: grey or with the colours of their MTL file, lit and framed so that something is seen."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wdpm.scenes.framing import framed_scene
from wdpm.scenes.mesh_data import MeshData
from wdpm.scenes.model import RGB, Material, Mesh, Scene
from wdpm.scenes.mtl import MtlMaterial, read_mtl
from wdpm.scenes.obj import ObjFile, read_obj
from wdpm.scenes.off import read_off
from wdpm.scenes.ply import read_ply
from wdpm.scenes.stl import read_stl

GREY = Material("grey", (0.5, 0.5, 0.5), twosided=True)


def read_stand_alone(file: Path, size: tuple[int, int] | None = None) -> Scene:
    """Reads an OBJ, PLY, STL or OFF file. Vertex normals are used where the file has them.

    Raises:
        SceneError: the file is broken.
    """
    if file.suffix.lower() == ".obj":
        return _read_obj_scene(file, size)
    read = {".ply": read_ply, ".stl": read_stl, ".off": read_off}[file.suffix.lower()]
    mesh = read(file)
    return framed_scene(file.stem, [_placed(file.stem, mesh, 0, None)], [GREY], size=size, warnings=[])


def _placed(name: str, mesh: MeshData, material: int, emission: RGB | None) -> Mesh:
    return Mesh(name, mesh.vertices, mesh.faces, mesh.normals, mesh.uvs, material, emission)


def _read_obj_scene(file: Path, size: tuple[int, int] | None) -> Scene:
    obj = read_obj(file)
    warnings = list(obj.warnings)
    library = _read_libraries(obj, file, warnings)
    materials: list[Material] = []
    meshes: list[Mesh] = []
    for number, name in enumerate(obj.materials):
        entry = library.get(name)
        if entry is None and name:
            warnings.append(f'{file.name}: material "{name}" is in no library: grey is used')
        materials.append(GREY if entry is None else entry.material)
        emission = None if entry is None else entry.emission
        meshes.append(_placed(name or file.stem, _part(obj, number), number, emission))
    return framed_scene(file.stem, meshes, materials, size=size, warnings=warnings)


def _part(obj: ObjFile, material: int) -> MeshData:
    """The triangles of one material, with the vertices that they use."""
    faces = obj.mesh.faces[obj.face_material == material]
    used, renumbered = np.unique(faces, return_inverse=True)
    mesh = obj.mesh
    return MeshData(
        mesh.vertices[used],
        renumbered.reshape(-1, 3),
        None if mesh.normals is None else mesh.normals[used],
        None if mesh.uvs is None else mesh.uvs[used],
    )


def _read_libraries(obj: ObjFile, file: Path, warnings: list[str]) -> dict[str, MtlMaterial]:
    found: dict[str, MtlMaterial] = {}
    for name, line in obj.libraries:
        named = file.parent / name.replace("\\", "/")
        # exporters write paths of their own machine; the library then mostly lies beside the model
        library = next((path for path in (named, file.parent / named.name) if path.is_file()), None)
        if library is None:
            warnings.append(f'{file.name}:{line}: material library "{name}" not found: grey is used')
        else:
            found.update(read_mtl(library, warnings))
    return found
