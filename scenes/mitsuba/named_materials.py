"""OBJ files whose materials a Mitsuba 0.6 scene names: `<bsdf name="paint">` is for the faces after `usemtl paint`."""

from __future__ import annotations

from dataclasses import replace

from wdpm.scenes.meshes.mesh_data import MeshData
from wdpm.scenes.meshes.obj_file import ObjFile
from wdpm.scenes.meshes.stand_alone import part_of
from wdpm.scenes.mitsuba.materials import MaterialReader
from wdpm.scenes.mitsuba.plugin import Plugin, snake_case

NamedBsdfs = list[tuple[str, Plugin]]
"""Bsdfs nested in a shape, each with the name that it is nested under, "" without one."""


def take_named_bsdfs(shape: Plugin, *, old: bool) -> NamedBsdfs:
    """The bsdfs of an OBJ file's materials; empty where one bsdf is for the whole shape.

    Args:
        old: whether the scene is for a version before Mitsuba 1: later ones take a single bsdf.
    """
    return shape.take_named("bsdf") if old and shape.type == "obj" and shape.count_nested("bsdf") > 1 else []


def parts_of(
    shape: Plugin, mesh: MeshData, obj: ObjFile, bsdfs: NamedBsdfs, materials: MaterialReader, *, emits: bool
) -> list[tuple[str, MeshData, int]]:
    """Name, triangles and material of each of an OBJ file's materials.

    Args:
        mesh: the triangles of the file, in its order, in their place.
        bsdfs: by material; one without a name is for all that have none of their own.

    Raises:
        SceneError: the same name twice, or a bsdf that cannot be read.
    """
    by_name: dict[str, Plugin] = {}
    for name, bsdf in bsdfs:
        if name in by_name:
            raise bsdf.error(f'{shape}: two bsdfs for the material "{name}" of its file')
        by_name[name] = bsdf
    known = {snake_case(name) for name in obj.materials}
    for name, bsdf in by_name.items():
        if name and name not in known:
            has = ", ".join(f'"{each}"' for each in obj.materials if each) or "none"
            shape.rules.tell(bsdf.line, f'{shape}: its file has no material "{name}" (it has {has}): nothing shows it')
    whole = replace(obj, mesh=mesh)
    parts: list[tuple[str, MeshData, int]] = []
    for number, name in enumerate(obj.materials):
        own = by_name.get(snake_case(name), by_name.get(""))
        if own is None:
            shape.rules.tell(shape.line, f'{shape}: no bsdf for the material "{name}" of its file: it is grey')
        parts.append((f"{shape.name} {name}".rstrip(), part_of(whole, number), materials.read(own, emits=emits)))
    return parts
