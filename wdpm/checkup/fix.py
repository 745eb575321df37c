"""A mended copy of a mesh file: what can be dropped, joined or turned without a choice that only its maker can make."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import trimesh
from numpy.typing import NDArray

from wdpm.checkup.soup import Bools, Ints, edges_of, pieces, volumes
from wdpm.scenes.errors import SceneError, SettingsError
from wdpm.scenes.meshes.mesh_data import MeshData, VertexAttribute, merge_corners
from wdpm.scenes.meshes.obj import read_obj
from wdpm.scenes.meshes.off import read_off
from wdpm.scenes.meshes.ply import read_ply
from wdpm.scenes.meshes.stl import read_stl
from wdpm.scenes.meshes.vertex_attributes import VERTEX_COLOR

READERS = {".ply": read_ply, ".stl": read_stl, ".off": read_off}
MESH_FILES = (".obj", *READERS)


@dataclass(frozen=True)
class Mended:
    """What was done.

    Attributes:
        changes: one line each; empty if there was nothing to mend.
    """

    output: Path
    changes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _File:
    """A mesh file: its triangles, and of each its material (OBJ only)."""

    mesh: MeshData
    material: Ints
    materials: tuple[str, ...] = ("",)
    libraries: tuple[str, ...] = ()


def mend(source: Path, output: Path) -> Mended:
    """Write a mended copy of a mesh file.

    Triangles without area, with corners that are not finite, and second copies are dropped; vertices in one place with
    the same attributes become one; neighbours are made to face the same way, and closed bodies outwards.

    Args:
        source: .obj, .ply, .stl or .off.
        output: any of these, in a folder that exists; not the source.

    Raises:
        SettingsError: the source is no mesh file, or the output is the source or of another kind.
        SceneError: the source cannot be read, or nothing is left of it.
    """
    if source.suffix.lower() not in MESH_FILES:
        raise SettingsError(f"--fix mends mesh files ({', '.join(MESH_FILES)}) only{_named_by(source)}")
    if output.suffix.lower() not in MESH_FILES:
        raise SettingsError(f"--fix {output}: expected a name that ends with {', '.join(MESH_FILES)}")
    if output.exists() and source.exists() and output.samefile(source):
        raise SettingsError(f"--fix {output}: that is the scene itself, which is never overwritten; name another file")
    if not output.parent.is_dir():
        raise SettingsError(f"--fix {output}: the folder {output.parent} does not exist")
    changes: list[str] = []
    file = _read(source, changes)
    file = _without_broken(file, changes)
    if not len(file.mesh.faces):
        raise SceneError("no triangle is left to write: all are broken or without area", source)
    file = _joined(file, changes)
    file = _turned(file, changes)
    if file.libraries and output.suffix.lower() == ".obj" and output.parent.resolve() != source.parent.resolve():
        changes.append(f"its material libraries are looked for beside it: copy {', '.join(file.libraries)}")
    _write(file, output, changes)
    return Mended(output, tuple(changes))


def _named_by(scene: Path) -> str:
    """What to mend instead: the mesh files that a Mitsuba scene names."""
    if scene.suffix.lower() != ".xml" or not scene.is_file():
        return f", and {scene.name} is none"
    values = (element.get("value", "") for element in ElementTree.parse(scene).iter("string"))
    files = sorted({value for value in values if value.lower().endswith(MESH_FILES)})
    return (
        f": mend {', '.join(files)}, and name the copies in {scene.name}" if files else f", and {scene.name} names none"
    )


def _read(source: Path, changes: list[str]) -> _File:
    """The file; where it is too broken for a render, what trimesh can make of its bare triangles."""
    try:
        return _read_whole(source)
    except SceneError as refusal:
        try:
            found = trimesh.load(source, process=False, force="mesh", skip_materials=True)
        except Exception:  # its parsers raise whatever a broken file makes them trip over
            raise refusal from None
        if not len(getattr(found, "faces", ())):
            raise
        changes.append(f"read without materials, normals and texture coordinates, since {refusal}")
        mesh = MeshData(np.asarray(found.vertices, np.float64), np.asarray(found.faces, np.int64))
        return _File(mesh, np.zeros(len(mesh.faces), np.int64))


def _read_whole(source: Path) -> _File:
    if source.suffix.lower() == ".obj":
        obj = read_obj(source)
        return _File(
            obj.mesh, obj.face_material.astype(np.int64), obj.materials, tuple(name for name, _ in obj.libraries)
        )
    mesh = READERS[source.suffix.lower()](source)
    return _File(mesh, np.zeros(len(mesh.faces), np.int64))


def _kept(file: _File, rows: Bools) -> _File:
    mesh = dataclasses.replace(file.mesh, faces=file.mesh.faces[rows])
    return dataclasses.replace(file, mesh=mesh, material=file.material[rows])


def _without_broken(file: _File, changes: list[str]) -> _File:
    """Drops what no renderer can show, and second copies of triangles of one material that face the same way."""
    finite = np.asarray(np.isfinite(file.mesh.vertices[file.mesh.faces]).all(axis=(1, 2)))
    if not finite.all():
        changes.append(f"{int((~finite).sum()):,} triangles with corners that are not finite dropped")
        file = _kept(file, finite)
    corners = file.mesh.vertices[file.mesh.faces]
    flat = ~np.asarray(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).any(axis=1))
    if flat.any():
        changes.append(f"{int(flat.sum()):,} triangles without area dropped")
        file = _kept(file, ~flat)
    if len(file.mesh.faces):
        place = _places(file.mesh.vertices)[file.mesh.faces]
        # Corners in the same cyclic order, whichever comes first.
        first = np.argmin(place, axis=1)
        cyclic = np.take_along_axis(place, (first[:, None] + np.arange(3)) % 3, axis=1)
        keys = np.column_stack([cyclic, file.material])
        chosen = np.zeros(len(keys), np.bool_)
        chosen[np.unique(keys, axis=0, return_index=True)[1]] = True
        if not chosen.all():
            changes.append(f"{int((~chosen).sum()):,} triangles that were there twice dropped")
            file = _kept(file, chosen)
    return file


def _joined(file: _File, changes: list[str]) -> _File:
    """Makes one vertex of those in one place with the same attributes, and drops those that nothing uses."""
    mesh = file.mesh
    columns = [mesh.vertices]
    columns += [values for values in (mesh.normals, mesh.uvs) if values is not None]
    columns += [attribute.values for attribute in mesh.attributes.values()]
    used = np.unique(mesh.faces)
    table = np.concatenate([np.asarray(values)[used] for values in columns], axis=1) + 0.0
    first, number = merge_corners(*_codes(table))
    renumber = np.zeros(len(mesh.vertices), np.int64)
    renumber[used] = number
    keep = used[first]
    if len(used) > len(keep):
        changes.append(f"{len(used) - len(keep):,} vertices joined with others in the same place")
    if len(mesh.vertices) > len(used):
        changes.append(f"{len(mesh.vertices) - len(used):,} vertices that no triangle uses dropped")
    attributes = {n: VertexAttribute(a.values[keep], a.coded) for n, a in mesh.attributes.items()}
    joined = MeshData(
        mesh.vertices[keep],
        renumber[mesh.faces],
        None if mesh.normals is None else mesh.normals[keep],
        None if mesh.uvs is None else mesh.uvs[keep],
        attributes,
    )
    return dataclasses.replace(file, mesh=joined)


def _codes(table: NDArray[np.float64]) -> list[Ints]:
    """Numbers for the values of each column; equal values have equal ones."""
    return [np.unique(column, return_inverse=True)[1] for column in table.T]


def _places(vertices: NDArray[np.float64]) -> Ints:
    """A number for each vertex, the same for those in one place, shape [V]."""
    return merge_corners(*_codes(vertices + 0.0))[1].astype(np.int64)


def _turned(file: _File, changes: list[str]) -> _File:
    """Makes neighbours face the same way, as most of their piece do, and closed pieces outwards.

    Where there are normals they say which side a render takes for the front: the corners then follow them.
    """
    mesh = file.mesh
    vertex = _places(mesh.vertices)[mesh.faces]
    edges = edges_of(vertex)
    flip = _consistent(edges.of, edges.uses, vertex)
    piece = pieces(edges)
    size = int(piece.max()) + 1
    corners = mesh.vertices[mesh.faces]
    front = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    mostly = np.bincount(piece, np.where(flip, -1.0, 1.0), size)
    closed = np.bincount(piece, (edges.uses[edges.of] % 2 != 0).any(axis=1), size) == 0
    volume = volumes(corners, np.where(flip[:, None], -front, front), piece)
    backwards = np.where(closed & (volume != 0), volume < 0, mostly < 0)
    turned = flip ^ backwards[piece]
    if mesh.normals is not None:
        side = np.einsum("ij,ij->i", front, mesh.normals[mesh.faces].sum(axis=1))
        turned = np.where(side != 0, side < 0, turned)
    if not turned.any():
        return file
    faces = mesh.faces.copy()
    faces[turned] = faces[turned][:, ::-1]
    changes.append(f"{int(turned.sum()):,} triangles turned to face as their normals or neighbours do, or outwards")
    return dataclasses.replace(file, mesh=dataclasses.replace(mesh, faces=faces))


def _consistent(of: Ints, uses: Ints, vertex: Ints) -> Bools:
    """Which triangles to turn so that neighbours agree, starting from the first of each piece, shape [T].

    Breadth first, a ring of neighbours at a time. A Möbius strip keeps a seam.
    """
    triangle = np.repeat(np.arange(len(of)), 3)
    forward = (vertex < np.roll(vertex, -1, axis=1)).ravel()
    order = np.argsort(of.ravel(), kind="stable")
    pairs = np.flatnonzero((np.diff(of.ravel()[order]) == 0) & (uses[of.ravel()[order[:-1]]] == 2))
    one, other = order[pairs], order[pairs + 1]
    unlike = forward[one] == forward[other]
    one, other = triangle[one], triangle[other]
    both = np.concatenate([one, other])
    towards = np.concatenate([other, one])
    turn = np.concatenate([unlike, unlike])
    by_triangle = np.argsort(both, kind="stable")
    begin = np.searchsorted(both[by_triangle], np.arange(len(of) + 1))
    flip = np.zeros(len(of), np.bool_)
    seen = np.zeros(len(of), np.bool_)
    for start in range(len(of)):
        if seen[start]:
            continue
        seen[start] = True
        ring = [start]
        while ring:
            following = []
            for t in ring:
                for link in by_triangle[begin[t] : begin[t + 1]]:
                    neighbour = int(towards[link])
                    if not seen[neighbour]:
                        seen[neighbour] = True
                        flip[neighbour] = flip[t] ^ turn[link]
                        following.append(neighbour)
            ring = following
    return flip


def _write(file: _File, output: Path, changes: list[str]) -> None:
    """Writes the file, and tells what its format cannot hold."""
    kind = output.suffix.lower()
    mesh = file.mesh
    if kind == ".obj":
        output.write_text(_obj_text(file), encoding="utf-8")
        return
    lost = ["texture coordinates"] if mesh.uvs is not None else []
    lost += ["materials"] if len(file.materials) > 1 or file.libraries else []
    lost += ["vertex normals"] if mesh.normals is not None and kind != ".ply" else []
    colors = mesh.attributes.get(VERTEX_COLOR) if kind == ".ply" else None
    lost += [f'"{name}"' for name, a in mesh.attributes.items() if a is not colors]
    if lost:
        changes.append(
            f"left out, since {kind} files as written here do not hold them: {', '.join(lost)}; .obj holds more"
        )
    shown = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    if mesh.normals is not None and kind == ".ply":
        shown.vertex_normals = mesh.normals
    if colors is not None:
        shown.visual.vertex_colors = np.rint(255.0 * np.clip(colors.values[:, :3], 0, 1)).astype(np.uint8)
    options = {"vertex_normal": mesh.normals is not None} if kind == ".ply" else {}
    shown.export(output, file_type=kind[1:], **options)


def _obj_text(file: _File) -> str:
    mesh = file.mesh
    colors = mesh.attributes.get(VERTEX_COLOR)
    rows = mesh.vertices if colors is None else np.column_stack([mesh.vertices, colors.values[:, :3]])
    lines = [f"mtllib {name}" for name in file.libraries]
    lines += ["v " + " ".join(map(repr, row)) for row in rows.tolist()]
    if mesh.uvs is not None:
        lines += ["vt " + " ".join(map(repr, row)) for row in mesh.uvs.tolist()]
    if mesh.normals is not None:
        lines += ["vn " + " ".join(map(repr, row)) for row in mesh.normals.tolist()]
    corner = "{0}/{0}/{0}" if mesh.uvs is not None else "{0}//{0}"
    if mesh.normals is None:
        corner = "{0}/{0}" if mesh.uvs is not None else "{0}"
    for number, name in enumerate(file.materials):
        if name:
            lines.append(f"usemtl {name}")
        faces = mesh.faces[file.material == number] + 1
        lines += ["f " + " ".join(corner.format(v) for v in face) for face in faces.tolist()]
    return "\n".join(lines) + "\n"
