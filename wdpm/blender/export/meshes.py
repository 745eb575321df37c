"""Blender's evaluated geometry, instances and all, as triangles in world space."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.blender.export.notes import Notes
from wdpm.scenes.model.transforms import apply_to_normals, apply_to_points

Array = NDArray[np.float64]

SURFACES = frozenset({"MESH"})
"""Types of objects whose faces are rendered: what else has faces (curves, text, metaballs) is followed by a mesh of
them, which Blender makes for the render."""

SILENT = frozenset(
    {"EMPTY", "CAMERA", "LIGHT", "ARMATURE", "LATTICE", "SPEAKER", "LIGHT_PROBE", "CURVE", "SURFACE", "FONT", "META"}
)
"""Types of objects that no picture shows, or that are read elsewhere."""


@dataclass(frozen=True, eq=False)
class Geometry:
    """An object's triangles in its own space, a corner each.

    Attributes:
        vertices: float64, shape [V, 3].
        faces: int64, shape [F, 3], indices into vertices.
        corners: int64, shape [F, 3], indices into what is kept by corner.
        slots: material slot of each face, int64, shape [F].
        normals: by corner, shape [C, 3], or None where all faces are flat.
        uvs: name of the map -> by corner, shape [C, 2]; the one that is active in renders also has the name "".
        colors: name of the attribute -> linear RGB by corner, shape [C, 3]; the active one also has the name "".
    """

    vertices: Array
    faces: NDArray[np.int64]
    corners: NDArray[np.int64]
    slots: NDArray[np.int64]
    normals: Array | None
    uvs: dict[str, Array]
    colors: dict[str, Array]


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles of one material slot of one instance, in world space; the fields are those of scenes.model.Mesh."""

    vertices: Array
    faces: NDArray[np.int64]
    normals: Array | None
    uvs: Array | None
    colors: Array | None


@dataclass(frozen=True, eq=False)
class Instance:
    """An object as it stands in the scene.

    Attributes:
        to_world: shape [4, 4].
        materials: Blender's material in each slot, or None where a slot is empty.
    """

    name: str
    geometry: Geometry
    to_world: Array
    materials: tuple[Any, ...]


def read_instances(depsgraph: Any, notes: Notes) -> Iterator[Instance]:
    """All that is to be rendered and has faces, each instance by itself; geometry that they share is read once."""
    known: dict[tuple[int, str], Geometry | None] = {}
    for each in depsgraph.object_instances:
        thing = each.object
        if not each.show_self:
            continue
        if thing.type not in SURFACES:
            if thing.type not in SILENT:
                notes.add(f'object "{thing.name}"', f"{thing.type.lower()} objects are not supported: it is left out")
            continue
        _note_visibility(thing, notes)
        # Instances of geometry nodes stand on a temporary object, whose data tell them apart.
        key = thing.data.as_pointer(), thing.name_full
        if key not in known:
            known[key] = _read_geometry(thing, depsgraph)
        geometry = known[key]
        if geometry is not None:
            yield Instance(thing.name, geometry, np.array(each.matrix_world, np.float64), _materials(thing))


def _note_visibility(thing: Any, notes: Notes) -> None:
    owner = f'object "{thing.name}"'
    rays = ("camera", "diffuse", "glossy", "transmission", "shadow")
    hidden = [ray for ray in rays if not getattr(thing, f"visible_{ray}")]
    if hidden:
        notes.add(owner, f"visibility by kind of ray ({', '.join(hidden)}) is not supported: all rays see it")
    for flag, what in (("is_holdout", "holdout"), ("is_shadow_catcher", "shadow catcher")):
        if getattr(thing, flag):
            notes.add(owner, f"{what}s are not supported: it is rendered as it is")


def _materials(thing: Any) -> tuple[Any, ...]:
    if len(thing.material_slots):
        return tuple(slot.material for slot in thing.material_slots)
    return tuple(getattr(thing.data, "materials", ())) or (None,)


def _read_geometry(thing: Any, depsgraph: Any) -> Geometry | None:
    mesh = thing.to_mesh(preserve_all_data_layers=True, depsgraph=depsgraph)
    if mesh is None:
        return None
    try:
        return _geometry_of(mesh) if len(mesh.polygons) else None
    finally:
        thing.to_mesh_clear()


def _geometry_of(mesh: Any) -> Geometry:
    mesh.calc_loop_triangles()
    triangles = mesh.loop_triangles
    flat = mesh.normals_domain == "FACE"
    return Geometry(
        _numbers(mesh.vertices, "co", 3),
        _whole(triangles, "vertices", 3),
        _whole(triangles, "loops", 3),
        _whole(triangles, "material_index", 1)[:, 0],
        None if flat else _numbers(mesh.corner_normals, "vector", 3),
        _uv_maps(mesh),
        _color_attributes(mesh),
    )


def _numbers(items: Any, name: str, width: int) -> Array:
    values = np.empty(len(items) * width, np.float32)
    items.foreach_get(name, values)
    return values.reshape(-1, width).astype(np.float64)


def _whole(items: Any, name: str, width: int) -> NDArray[np.int64]:
    values = np.empty(len(items) * width, np.int32)
    items.foreach_get(name, values)
    return values.reshape(-1, width).astype(np.int64)


def _uv_maps(mesh: Any) -> dict[str, Array]:
    maps = {layer.name: _numbers(layer.uv, "vector", 2) for layer in mesh.uv_layers}
    active = next((layer.name for layer in mesh.uv_layers if layer.active_render), None)
    return maps if active is None else {**maps, "": maps[active]}


def _color_attributes(mesh: Any) -> dict[str, Array]:
    found = {}
    corners = _whole(mesh.loops, "vertex_index", 1)[:, 0] if len(mesh.color_attributes) else None
    for attribute in mesh.color_attributes:
        values = _numbers(attribute.data, "color", 4)[:, :3]
        found[attribute.name] = values if attribute.domain == "CORNER" else values[corners]
    active = mesh.color_attributes.render_color_index
    if 0 <= active < len(mesh.color_attributes):
        found[""] = found[mesh.color_attributes[active].name]
    return found


def part_of(instance: Instance, slot: int, uv_map: str | None, color: str | None) -> Part | None:
    """The triangles of a material slot, or None where it has none.

    Args:
        uv_map, color: names of what its material reads, "" for what is active; None for nothing.
    """
    geometry = instance.geometry
    chosen = np.minimum(geometry.slots, len(instance.materials) - 1) == slot
    if not chosen.any():
        return None
    points, corners = geometry.faces[chosen].reshape(-1), geometry.corners[chosen].reshape(-1)
    black = np.zeros((int(geometry.corners.max()) + 1, 3))  # an attribute that is not there
    kept = (
        geometry.normals,
        None if uv_map is None else geometry.uvs.get(uv_map),
        None if color is None else geometry.colors.get(color, black),
    )
    columns = [np.zeros((len(points), 0)) if values is None else values[corners] for values in kept]
    first, faces = _welded(points, columns)
    normals, uvs, colors = (column[first] if column.shape[1] else None for column in columns)
    return _placed(Part(geometry.vertices[points[first]], faces, normals, uvs, colors), instance.to_world)


def _welded(points: NDArray[np.int64], columns: list[Array]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Which corners stand for all alike, and the faces in terms of those."""
    rows = np.concatenate([points[:, None].astype(np.float64), *columns], axis=1)
    order = np.lexsort(rows.T[::-1])
    new = np.ones(len(order), np.bool_)
    new[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    number = np.empty(len(order), np.int64)
    number[order] = np.cumsum(new) - 1
    return order[new], number.reshape(-1, 3)


def _placed(part: Part, to_world: Array) -> Part:
    """In world space; where the instance mirrors, faces turn over with it, as Blender has them."""
    normals = part.normals
    faces = part.faces
    if np.linalg.det(to_world[:3, :3]) < 0.0:
        faces = faces[:, ::-1]
    elif np.linalg.det(to_world[:3, :3]) == 0.0:
        normals = None  # flattened: no normal is left to transform
    if normals is not None:
        normals = apply_to_normals(to_world, normals)
    return Part(apply_to_points(to_world, part.vertices), np.ascontiguousarray(faces), normals, part.uvs, part.colors)
