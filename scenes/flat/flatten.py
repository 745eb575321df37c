"""A scene as flat arrays: what kernels read and what travels to slaves.

Triangles carry their own vertices (a soup): a cell then holds just what it owns, a leaf's triangles lie one after
another in memory, and no index can point outside a partition.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.flat.arrays import ARRAYS, NO_TRIANGLES, Media, Triangles
from wdpm.scenes.flat.dropped import CAUSES, KEPT, counted, drop_cause, mark_small
from wdpm.scenes.flat.grids import tabulate_grids
from wdpm.scenes.flat.lamps.hidden import hides_lamps
from wdpm.scenes.flat.light_table import LightTable, tabulate_lights
from wdpm.scenes.flat.material_coats import with_coats
from wdpm.scenes.flat.material_table import NO_MEDIUM, SAME_MEDIUM, Boundary, MaterialTable, tabulate
from wdpm.scenes.flat.reach import largest_coordinate
from wdpm.scenes.flat.renderer_space import RendererSpace, renderer_space
from wdpm.scenes.flat.room import Room, let_go
from wdpm.scenes.flat.shapes import Instancing, Stage, Standing, choose, hold
from wdpm.scenes.flat.surface_order import AreaBefore
from wdpm.scenes.model.bsdfs import walk
from wdpm.scenes.model.lights import DeltaLight, Light
from wdpm.scenes.model.scene import Camera, Instance, Material, Medium, Scene, Solid
from wdpm.scenes.model.textures import Bitmap, Checkerboard, Texture, VertexColors
from wdpm.scenes.model.transforms import normalized
from wdpm.scenes.model.volumes import Volume


@dataclass(frozen=True, eq=False)
class FlatScene:
    """A scene as arrays, in the renderer's space (renderer_space): the middle of its bounding box is the origin.

    Attributes:
        triangles: numbered in the order of the meshes, without the dropped ones; lamps first where one is hidden.
        materials: its first rows are what Triangles.material names.
        material_names: of those first rows.
        textures: each once.
        lights: all that emits.
        camera: moved like the scene.
        center: what was subtracted from the scene's coordinates, float64, shape [3].
        unit: by what lengths were divided then. Lengths here times this are the scene's, fluxes times its square.
        extent: largest absolute coordinate of any vertex, light with a place or the camera.
        dropped: number of triangles left out, by cause.
    """

    triangles: Triangles
    materials: MaterialTable
    material_names: tuple[str, ...]
    textures: tuple[Texture, ...]
    lights: LightTable
    media: Media
    camera: Camera
    center: NDArray[np.float64]
    unit: float
    extent: float
    dropped: dict[str, int]


def flatten(scene: Scene, instancing: Instancing = Instancing.AUTO, room: Room = np.empty) -> FlatScene:
    """Turns a scene into arrays.

    Coordinates are moved and divided in double precision before they are rounded, see renderer_space.

    Args:
        instancing: which instances stay instances. What is rendered is the same, bit for bit.
        room: where the arrays of the triangles are put, scenes.flat.room; those of shapes of instances are in memory.

    Raises:
        SceneError: an index out of range, too many triangles, or none is left.
    """
    space = renderer_space(scene.meshes)
    lights = [space.light(light) for light in scene.lights]
    emitters = [mesh for mesh in scene.meshes if _glows(mesh)]
    rows = _Rows(scene, [space.material(material) for material in scene.materials])
    triangles, dropped = _triangles(scene.meshes, emitters, space, rows, instancing, room)
    if hides_lamps(triangles):
        others = [mesh for mesh in scene.meshes if not _glows(mesh)]
        triangles, dropped = _triangles([*emitters, *others], emitters, space, rows, instancing, room)
    if triangles.total == 0:
        raise SceneError(f"no triangle of the scene can be rendered: {_listed(dropped)}")
    camera = space.camera(scene.camera)
    _check_factors(scene.materials)
    materials, textures = tabulate(rows.boundaries)
    materials = with_coats(materials)
    textures, emitter_texture = _with_emission(textures, emitters, lights)
    sides = materials.medium[triangles.material] if scene.media else None
    table = tabulate_lights(emitters, triangles, emitter_texture, textures, lights, sides, camera)
    places: list[NDArray[np.floating]] = [table.delta_position[: table.near], camera.to_world[:3, 3]]
    reach = largest_coordinate(triangles)
    triangles.let_go()
    return FlatScene(
        triangles=triangles,
        materials=materials,
        material_names=rows.names,
        textures=textures,
        lights=table,
        media=_media([space.medium(medium) for medium in scene.media]),
        camera=camera,
        center=space.center,
        unit=space.unit,
        extent=max(reach, *(float(np.abs(place).max(initial=0.0)) for place in places)),
        dropped=dropped,
    )


def _triangles(
    meshes: Sequence[Solid],
    emitters: Sequence[Solid],
    space: RendererSpace,
    rows: _Rows,
    instancing: Instancing,
    room: Room,
) -> tuple[Triangles, dict[str, int]]:
    """All triangles that can be rendered, numbered in the order of the meshes, and how many of others by cause."""
    emitter_index = {id(mesh): index for index, mesh in enumerate(emitters)}
    material = [rows.of(mesh) for mesh in meshes]
    stage = Stage(space, _glows)
    standing = [stage.stand(mesh) if isinstance(mesh, Instance) else None for mesh in meshes]
    total = sum(
        len(mesh.faces) if each is None else len(each.cause) for mesh, each in zip(meshes, standing, strict=True)
    )
    if total > MOST_TRIANGLES:
        raise SceneError(
            f"{total:,} triangles, those of instances counted where they stand: at most {MOST_TRIANGLES:,}"
        )
    kept = choose(meshes, standing, instancing)
    apart = [number for number, is_kept in enumerate(kept) if not is_kept]
    sizes = [len(meshes[number].faces) for number in apart]
    colored = any(mesh.colors is not None for mesh in meshes)
    parts = (
        _soup(meshes[number], space, material[number], emitter_index.get(id(meshes[number]), -1), standing[number])
        for number in apart
    )
    soup = _joined([meshes[number] for number in apart], parts, sum(sizes), colored, room)
    cause = _cause(soup, [standing[number] for number in apart], sizes)
    mark_small(cause, [meshes[number] for number in apart], sizes)
    held = _Counter()
    counts = np.array([held.kept(each) if k and each else 0 for each, k in zip(standing, kept, strict=True)], np.int64)
    counts[apart] = _kept_of_parts(cause, sizes)
    bases = np.cumsum(counts) - counts
    soup = soup if not cause.any() else soup.take(np.flatnonzero(cause == KEPT))
    _number(soup.ids, bases[apart], counts[apart])
    before = _tell_area_before(soup, standing, kept, counts.tolist())
    chosen = [
        (each, material[i], int(bases[i]), before[i])
        for i, each in enumerate(standing)
        if each and kept[i] and counts[i]
    ]
    return replace(soup, instances=hold(chosen, colored)), held.dropped_with(cause)


def _number(ids: NDArray[np.int32], bases: NDArray[np.int64], counts: NDArray[np.int64]) -> None:
    """Number triangles: so many of each mesh, from its base on."""
    first = 0
    for base, count in zip(bases.tolist(), counts.tolist(), strict=True):
        ids[first : first + count] = np.arange(base, base + count, dtype=np.int32)
        first += count


def _tell_area_before(
    soup: Triangles, standing: Sequence[Standing | None], kept: Sequence[bool], counts: Sequence[int]
) -> list[float]:
    """Tell the triangles of a soup what area comes before them.

    Args:
        standing, kept, counts: of each mesh, whether it is not in the soup, and how many triangles it has.

    Returns:
        what comes before each mesh that is an instance.
    """
    areas, starts, first = AreaBefore(), [], 0
    for each, is_kept, count in zip(standing, kept, counts, strict=True):
        rows = slice(first, first + count)
        starts.append(areas.step(each.area) if each and count else 0.0)
        if is_kept:
            continue
        if each is None:
            soup.area_before[rows] = areas.of_mesh(soup.positions[rows])
        elif count:
            soup.area_before[rows] = starts[-1] + each.area_before[each.cause == KEPT]
        let_go(soup.positions[rows], soup.area_before[rows])
        first += count
    return starts


class _Counter:
    """Counts triangles of instances, looking at each of few arrays of causes once."""

    def __init__(self) -> None:
        self._seen: dict[int, tuple[NDArray[np.int8], dict[str, int]]] = {}
        self._dropped: Counter[str] = Counter()

    def kept(self, standing: Standing) -> int:
        """How many of an instance's triangles are kept; the others are counted."""
        cause = standing.cause
        if id(cause) not in self._seen:
            self._seen[id(cause)] = cause, counted(cause)
        dropped = self._seen[id(cause)][1]
        self._dropped.update(dropped)
        return len(cause) - sum(dropped.values())

    def dropped_with(self, cause: NDArray[np.int8]) -> dict[str, int]:
        """How many were dropped by cause, with those of an array."""
        self._dropped.update(counted(cause))
        return {words: self._dropped[words] for words in CAUSES.values() if words in self._dropped}


MOST_TRIANGLES = 2**31 - 1
"""Of a scene, those of instances counted where they stand: their numbers are 32 bits wide."""


def _cause(soup: Triangles, standing: Sequence[Standing | None], sizes: Sequence[int]) -> NDArray[np.int8]:
    """Why triangles of a soup are dropped; instances know it of themselves.

    Args:
        standing, sizes: of each mesh in it.
    """
    if all(each is None for each in standing):
        return drop_cause(soup.positions, soup.emitter >= 0)
    plain = np.repeat(np.array([each is None for each in standing], np.bool_), sizes)
    cause = np.zeros(len(soup), np.int8)
    cause[plain] = drop_cause(soup.positions[plain], soup.emitter[plain] >= 0)
    cause[~plain] = np.concatenate([np.zeros(0, np.int8), *(each.cause for each in standing if each is not None)])
    return cause


def _kept_of_parts(cause: NDArray[np.int8], sizes: Sequence[int]) -> list[int]:
    return [int(np.sum(own == KEPT)) for own in np.split(cause, np.cumsum(sizes)[:-1])] if len(sizes) else []


MOST_FACTOR = 1e6
"""Largest factor of a material that is rendered: beyond 1 light grows at every bounce, and soon beyond all numbers."""


def _check_factors(materials: Sequence[Material]) -> None:
    """Raise SceneError where a material's factor cannot be meant: loaders allow none above 1."""
    for material in materials:
        for node in walk(material.bsdf):
            for name in ("reflectance", "diffuse_reflectance", "specular_reflectance", "specular_transmittance"):
                value = getattr(node, name, None)
                if isinstance(value, tuple) and not max(value) <= MOST_FACTOR:
                    raise SceneError(f'material "{material.name}": {name} is {max(value):g}; expected at most 1')


class _Rows:
    """Rows of the material table: a material that bounds several pairs of media has as many rows."""

    def __init__(self, scene: Scene, materials: Sequence[Material]) -> None:
        self._scene = scene
        self._materials = materials
        self._row: dict[tuple[int, int, int], int] = {}
        self.boundaries: list[Boundary] = []
        self._names: list[str] = []
        for number in range(len(materials)):
            self._add(number, SAME_MEDIUM, SAME_MEDIUM)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._names)

    def of(self, mesh: Solid) -> int:
        """The row of a mesh's material between its media."""
        count = len(self._materials)
        if not 0 <= mesh.material < count:
            raise SceneError(f'mesh "{mesh.name}": there is no material {mesh.material} (there are {count})')
        if not mesh.bounds:
            return mesh.material
        media = [NO_MEDIUM if medium is None else medium for medium in (mesh.interior, mesh.exterior)]
        if not all(NO_MEDIUM <= medium < len(self._scene.media) for medium in media):
            raise SceneError(f'mesh "{mesh.name}": it names a medium out of range (there are {len(self._scene.media)})')
        inside, outside = media
        row = self._row.get((mesh.material, inside, outside))
        return self._add(mesh.material, inside, outside) if row is None else row

    def _add(self, number: int, inside: int, outside: int) -> int:
        material = self._materials[number]
        self._row[number, inside, outside] = len(self.boundaries)
        self.boundaries.append((material.bsdf, inside, outside))
        self._names.append(material.name)
        return len(self.boundaries) - 1


def _media(media: Sequence[Medium]) -> Media:
    volumes: list[Volume] = []
    density = [_number_of(medium.density, volumes) for medium in media]
    albedo = [_number_of(medium.albedo_volume, volumes) for medium in media]
    return Media(
        np.array([medium.sigma_t for medium in media], np.float32).reshape(-1, 3),
        np.array([medium.albedo for medium in media], np.float32).reshape(-1, 3),
        np.array([medium.g for medium in media], np.float32),
        np.array(density, np.int32),
        np.array(albedo, np.int32),
        tabulate_grids(volumes),
    )


def _number_of(volume: Volume | None, volumes: list[Volume]) -> int:
    """The place of a volume among all, where it is put if it is new; -1 for none."""
    if volume is None:
        return -1
    volumes.append(volume)
    return len(volumes) - 1


def _glows(mesh: Solid) -> bool:
    emission = mesh.emission
    if emission is None or not len(mesh.faces):
        return False
    return isinstance(emission, Bitmap | Checkerboard | VertexColors) or max(emission) > 0


def _with_emission(
    textures: tuple[Texture, ...], emitters: Sequence[Solid], lights: Sequence[Light]
) -> tuple[tuple[Texture, ...], NDArray[np.int32]]:
    """The textures of materials and of lights, and which one each emitter has."""
    joined = list(textures)
    number = {id(texture): index for index, texture in enumerate(joined)}
    chosen = np.full(len(emitters), -1, np.int32)
    for row, mesh in enumerate(emitters):
        if isinstance(mesh.emission, Bitmap | Checkerboard | VertexColors):
            if id(mesh.emission) not in number:
                number[id(mesh.emission)] = len(joined)
                joined.append(mesh.emission)
            chosen[row] = number[id(mesh.emission)]
    for light in lights:
        if isinstance(light, DeltaLight) and light.texture is not None and id(light.texture) not in number:
            number[id(light.texture)] = len(joined)
            joined.append(light.texture)
    return tuple(joined), chosen


def _soup(
    mesh: Solid, space: RendererSpace, material: int, emitter: int, standing: Standing | None = None
) -> Triangles:
    """A mesh's triangles with their own corners; what goes by their place among all is given later."""
    if standing is not None:
        return standing.copy(material, emitter)
    count = len(mesh.faces)
    if count and not (mesh.faces.min() >= 0 and mesh.faces.max() < len(mesh.vertices)):
        raise SceneError(f'mesh "{mesh.name}": a face names a vertex out of range (there are {len(mesh.vertices)})')
    return Triangles(
        np.zeros(count, dtype=np.int32),
        _corners(mesh, space),
        _corner_normals(mesh),
        np.zeros((count, 3, 2), dtype=np.float32) if mesh.uvs is None else mesh.uvs.astype(np.float32)[mesh.faces],
        np.full(count, material, dtype=np.int32),
        np.full(count, emitter, dtype=np.int32),
        np.zeros((0, 3, 3), dtype=np.float32),
        np.zeros(count),
    )


def _corners(mesh: Solid, space: RendererSpace) -> NDArray[np.float32]:
    """Of each triangle, in the renderer's space, shape [F, 3, 3]."""
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is dropped as such
        return space.place(mesh.vertices).astype(np.float32)[mesh.faces]


def _corner_normals(mesh: Solid) -> NDArray[np.float32]:
    if mesh.normals is None:
        return np.zeros((len(mesh.faces), 3, 3), dtype=np.float32)
    normals = normalized(mesh.normals).astype(np.float32)[mesh.faces]
    # a normal that is missing at one corner cannot be interpolated: the triangle is flat
    for first in range(0, len(normals), _AT_ONCE):
        block = normals[first : first + _AT_ONCE]
        there = block != 0  # axis by axis and corner by corner: NumPy is slow at rows of three
        of_corner = there[..., 0] | there[..., 1] | there[..., 2]
        block[~(of_corner[:, 0] & of_corner[:, 1] & of_corner[:, 2])] = 0.0
    return normals


_AT_ONCE = 1 << 16
"""Triangles that are looked at together."""


class Origins:
    """Where the triangles that `flatten` keeps are from, by their numbers."""

    def __init__(self, scene: Scene) -> None:
        space = renderer_space(scene.meshes)
        stage = Stage(space, _glows)
        standing = [stage.stand(mesh) if isinstance(mesh, Instance) else None for mesh in scene.meshes]
        plain = [mesh for mesh in scene.meshes if not isinstance(mesh, Instance)]
        sizes = [len(mesh.faces) for mesh in plain]
        positions = np.concatenate([np.zeros((0, 3, 3), np.float32), *(_corners(mesh, space) for mesh in plain)])
        glows = np.repeat(np.array([_glows(mesh) for mesh in plain], np.bool_), sizes)
        causes = iter(np.split(drop_cause(positions, glows), np.cumsum(sizes)[:-1]) if plain else [])
        self._rows = [np.flatnonzero((next(causes) if each is None else each.cause) == KEPT) for each in standing]
        self._ends = np.cumsum([len(rows) for rows in self._rows])

    def __len__(self) -> int:
        return int(self._ends[-1])

    def of(self, number: int) -> tuple[int, int]:
        """The number of a triangle's mesh, and its own number in that mesh."""
        mesh = int(np.searchsorted(self._ends, number, side="right"))
        rows = self._rows[mesh]
        return mesh, int(rows[number - (int(self._ends[mesh]) - len(rows))])


def _joined(meshes: Sequence[Solid], parts: Iterable[Triangles], total: int, colored: bool, room: Room) -> Triangles:
    """All parts as one, of which each is let go when it is in its place.

    If any mesh has vertex colours there are some at the corners of all triangles, white where a mesh has none.
    """
    columns: dict[str, NDArray[Any]] = {}
    for name in ARRAYS:
        of_one = getattr(NO_TRIANGLES, name)
        count = total if colored or name != "colors" else 0
        columns[name] = room((count, *of_one.shape[1:]), of_one.dtype)
    first = 0
    for mesh, part in zip(meshes, parts, strict=True):
        rows = slice(first, first + len(part))
        first = rows.stop
        for name in ARRAYS:
            if name != "colors":
                columns[name][rows] = getattr(part, name)
        if colored:
            columns["colors"][rows] = 1.0 if mesh.colors is None else mesh.colors.astype(np.float32)[mesh.faces]
        let_go(*(column[rows] for column in columns.values()))
    return NO_TRIANGLES.with_arrays(columns)


def _listed(dropped: dict[str, int]) -> str:
    return ", ".join(f"{count} dropped ({name})" for name, count in dropped.items())
