"""What type hints cannot say about a message: lengths that belong together, and ranges.

A kernel trusts the arrays it is given, so whatever comes over the wire is checked here first: no index that travels may
point outside.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from wdpm.cluster.allotment import Allotment, LampOutlines
from wdpm.cluster.batch import SCHEMAS, Batch, Kind
from wdpm.cluster.guide import CausticGuide, LightGuide
from wdpm.cluster.limits import MOST_SLAVES
from wdpm.cluster.lit_places import LitPlaces
from wdpm.cluster.messages import protocol
from wdpm.cluster.messages.batch_checks import check_runs, check_whole
from wdpm.cluster.messages.demands import Shape
from wdpm.cluster.messages.demands import indices as _indices
from wdpm.cluster.messages.demands import require as _require
from wdpm.cluster.messages.emission_checks import SHAPES_OF_EMISSION, check_steering
from wdpm.cluster.messages.guide_checks import SHAPES_OF_GUIDES, check_caustic_guide, check_light_guide
from wdpm.cluster.messages.instance_checks import SHAPES_OF_INSTANCES, check_area_before, check_instances, check_shapes
from wdpm.cluster.messages.short_bitmaps import ShortBitmap
from wdpm.cluster.messages.top_tree_checks import SHAPES_OF_CELLS, check_outlines, check_top_tree
from wdpm.cluster.messages.view_checks import check_allotment, check_lamp_outlines, check_view
from wdpm.cluster.records import CachePlan, Records
from wdpm.cluster.runs import Runs
from wdpm.cluster.task import BucketRendered, BucketTask, PhotonsTraced, PhotonTask, RecordTask
from wdpm.cluster.world import IrradiancePlan, MapPlan, Outlines, PhotonPlan, Steering, TopTree, View, World
from wdpm.kernels.fields import Many
from wdpm.kernels.limits import MAX_K
from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.flat.arrays import Media, Triangles
from wdpm.scenes.flat.grids import MOST_VALUES, WRAPS, Grids
from wdpm.scenes.flat.instances import Instances, Shapes
from wdpm.scenes.flat.light_table import LIGHT_KINDS, LightTable
from wdpm.scenes.flat.material_table import NORMAL_MAP, SAME_MEDIUM, MaterialTable
from wdpm.scenes.model.leaf_kind import SLOTS
from wdpm.scenes.model.light_kind import NUMBERS
from wdpm.scenes.model.scene import LARGEST_FILTER, Camera, PixelFilter
from wdpm.scenes.model.textures import Bitmap, Checkerboard

SHAPES: dict[type, dict[str, Shape]] = {
    **SHAPES_OF_CELLS,
    **SHAPES_OF_GUIDES,
    protocol.BuildMaps: {"regions": ("parts", 2, 3)},
    MaterialTable: {
        "kind": ("nodes",),
        "child": ("nodes", 2),
        "distribution": ("nodes",),
        "value": ("nodes", SLOTS, 3),
        "texture": ("nodes", SLOTS),
        "medium": ("nodes", 2),
    },
    LightTable: {
        "emitter_radiance": ("emitters", 3),
        "emitter_texture": ("emitters",),
        "prim": ("triangles",),
        "corners": ("triangles", 3, 3),
        "uvs": ("triangles", 3, 2),
        "colors": ("colored", 3, 3),
        "emitter": ("triangles",),
        "delta_kind": ("deltas",),
        "delta_position": ("deltas", 3),
        "delta_axes": ("deltas", 3, 3),
        "delta_color": ("deltas", 3),
        "delta_cutoff": ("deltas",),
        "delta_number": ("deltas", NUMBERS),
        "delta_texture": ("deltas",),
        "environment_pixels": ("height", "width", 3),
        "environment_axes": (3, 3),
        "medium": ("lights",),
        "power": ("elements",),
        "light": ("elements",),
    },
    Media: {
        "sigma_t": ("media", 3),
        "albedo": ("media", 3),
        "g": ("media",),
        "density_grid": ("media",),
        "albedo_grid": ("media",),
    },
    Grids: {
        "size": ("grids", 3),
        "to_lattice": ("grids", 3, 4),
        "low": ("grids", 3),
        "high": ("grids", 3),
        "nearest": ("grids",),
        "wrap": ("grids",),
        "channels": ("grids",),
        "values": ("values",),
    },
    **SHAPES_OF_EMISSION,
    Checkerboard: {"to_uv": (3, 3)},
    Bitmap: {"pixels": ("height", "width", 3), "to_uv": (3, 3)},
    ShortBitmap: {"palette": ("colours",), "pixels": ("height", "width", 3)},
    Camera: {"to_world": (4, 4)},
    LampOutlines: {"pixels": ("pixels",)},
    LitPlaces: {
        "position": ("places", 3),
        "normal": ("places", 3),
        "power": ("places",),
        "radius": ("places",),
    },
    Records: {
        "number": ("records",),
        "position": ("records", 3),
        "normal": ("records", 3),
        "irradiance": ("records", 3),
        "rotation": ("records", 3, 3),
        "translation": ("records", 3, 3),
        "grazing": ("records",),
        "radius": ("records",),
        "error": ("records",),
    },
    Triangles: {
        "ids": ("triangles",),
        "positions": ("triangles", 3, 3),
        "normals": ("triangles", 3, 3),
        "uvs": ("triangles", 3, 2),
        "material": ("triangles",),
        "emitter": ("triangles",),
        "colors": ("colored", 3, 3),
        "area_before": ("triangles",),
    },
    **SHAPES_OF_INSTANCES,
}
"""Shapes of arrays by class and field. A name stands for any length, the same wherever it occurs in one object."""

LAST_KIND = NORMAL_MAP
"""Of the nodes of a MaterialTable."""

LARGEST_HEMISPHERE = 1 << 16
"""Gather rays of an irradiance record."""

LARGEST_SIDE = 1 << 20
"""Pixels of an image's or a bucket's side."""

LARGEST_TASK = 1 << 20
"""Photon paths or candidates of one task, and ..."""

LARGEST_BUCKET = 1 << 22
"""... pixels of one. Each is some hundred bytes at its home, so that no task fills a machine."""

LONGEST_NAME = 256
"""Characters of a machine's name, an endpoint or a version."""

_ANY_NUMBER = 2**63 - 1

_INDICES: dict[Kind, tuple[tuple[str, int, int | Many, str], ...]] = {
    kind: tuple(
        (name, field.least, _ANY_NUMBER if field.end is None else field.end, f"{kind.value}.{name}")
        for name, field in schema.items()
        if field.least is not None
    )
    for kind, schema in SCHEMAS.items()
}
"""Columns of each kind of batch that have a range: name, least, end, and what the column is called in an error."""


def check(value: Any, where: str) -> None:
    """Raise ProtocolError unless a dataclass that came over the wire holds together."""
    shapes = SHAPES.get(type(value))
    if shapes is not None:
        _check_shapes(value, shapes, where)
    ranges = _RANGES.get(type(value))
    if ranges is not None:
        ranges(value, where)


def check_triangles(triangles: Triangles, world: World, where: str) -> None:
    """Raise ProtocolError unless triangles are in order and name only materials and emitters that the world has."""
    if np.any(triangles.ids[1:] <= triangles.ids[:-1]):
        raise ProtocolError(f"{where}: triangles are not in the order of their numbers")
    _indices(triangles.material, 0, len(world.materials), f"{where}: material")
    _indices(triangles.emitter, -1, len(world.lights.emitter_radiance), f"{where}: emitter")
    colored = len(triangles.colors)
    _require(colored in (0, len(triangles)), where, f"colours of {colored} triangles; there are {len(triangles)}")
    check_area_before(triangles.area_before, where)
    _indices(triangles.instances.shapes.material, 0, len(world.materials), f"{where}: material of a shape")


def check_batch(batch: Batch, world: World) -> None:
    """Raise ProtocolError unless every index, and every weight, in a batch of a peer is one that kernels can use.

    Slots are for the home to check, which knows how many it has.
    """
    media = len(world.media.g)
    how_many = {Many.CELLS: world.top_tree.cells, Many.LIGHTS: len(world.lights.names), Many.MEDIA: media}
    # Final hits are looked up among the cell's triangles; only in a medium do photons and paths land on none.
    final = batch.kind in (Kind.SHADE, Kind.CANDIDATE_HIT, Kind.SHADOW_WALK_HIT) or (
        batch.kind in (Kind.LANDED, Kind.VERTEX) and not media
    )
    for name, least, end, where in _INDICES[batch.kind]:
        least = 0 if name == "prim" and final else least
        _indices(batch.arrays[name], least, how_many[end] if isinstance(end, Many) else end, where)


def _check_shapes(value: Any, shapes: dict[str, Shape], where: str) -> None:
    lengths: dict[str, int] = {}
    for field, expected in shapes.items():
        shape = getattr(value, field).shape
        if len(shape) != len(expected):
            raise ProtocolError(f"{where}.{field} has shape {shape}; expected {_in_words(expected)}")
        for length, name in zip(shape, expected, strict=True):
            if length != (name if isinstance(name, int) else lengths.setdefault(name, length)):
                raise ProtocolError(f"{where}.{field} has shape {shape}; expected {_in_words(expected)}: {lengths}")


def _in_words(shape: Shape) -> str:
    return "[" + ", ".join(str(length) for length in shape) + "]"


def _positive(value: float) -> bool:
    return math.isfinite(value) and value > 0


def _lights(lights: LightTable, where: str) -> None:
    environments = int(lights.environment_pixels.size > 0)
    known = bool(np.isin(lights.delta_kind, list(LIGHT_KINDS)).all())
    _require(known and not np.any(np.diff(lights.delta_kind) < 0), where, "unknown kinds of lights, or not in order")
    elements = len(lights.corners) + len(lights.delta_kind) + environments
    _require(len(lights.power) == elements, where, f"power of {len(lights.power)} elements; there are {elements}")
    _require(len(lights.medium) == len(lights.power), where, "a medium for each element was expected")
    _indices(lights.light, 0, len(lights.names), f"{where}.light")
    _indices(lights.emitter, 0, len(lights.emitter_radiance), f"{where}.emitter")
    colored = len(lights.colors)
    _require(colored in (0, len(lights.prim)), where, f"colours of {colored} triangles")
    _require(not np.any(lights.prim[1:] <= lights.prim[:-1]), where, "triangles are not in the order of their numbers")


def _materials(table: MaterialTable, where: str) -> None:
    """Children come after their parents, so no walk through a tree is endless."""
    nodes = np.arange(len(table))[:, None]
    inner = table.child >= 0
    _indices(table.child.ravel(), -1, len(table), f"{where}.child")
    _require(bool((table.child > nodes)[inner].all()), where, "a node inside another comes before it")
    _indices(table.distribution, 0, 2, f"{where}.distribution")
    _indices(table.kind, 0, LAST_KIND + 1, f"{where}.kind")


def _media(media: Media, where: str) -> None:
    """A density is of one channel: its grid has blocks."""
    grids = media.grids
    _indices(media.density_grid, -1, len(grids), f"{where}.density_grid")
    _indices(media.albedo_grid, -1, len(grids), f"{where}.albedo_grid")
    used = media.density_grid[media.density_grid >= 0]
    _require(bool((grids.channels[used] == 1).all()), where, "a density of more than one channel")


def _grids(grids: Grids, where: str) -> None:
    """Values are as many as the sizes say, and boxes lie within their lattices."""
    _indices(grids.size.ravel(), 1, LARGEST_SIDE, f"{where}.size")
    _indices(grids.nearest, 0, 2, f"{where}.nearest")
    _indices(grids.wrap, 0, len(WRAPS), f"{where}.wrap")
    _require(bool(np.isin(grids.channels, (1, 3)).all()), where, f"channels {grids.channels}; expected 1 or 3")
    values = sum(math.prod(map(int, size)) * int(n) for size, n in zip(grids.size, grids.channels, strict=True))
    _require(values == len(grids.values) <= MOST_VALUES, where, f"{len(grids.values)} values; expected {values}")
    _require(bool(np.isfinite(grids.to_lattice).all()), where, "a place that is not finite")
    ends = grids.size - 1 + grids.nearest[:, None]
    inside = (grids.low >= 0) & (grids.low <= grids.high) & (grids.high <= ends)
    _require(bool(inside.all()), where, "a box beyond its lattice")


def _world(world: World, where: str) -> None:
    _indices(world.materials.texture.ravel(), -1, len(world.textures), f"{where}.materials.texture")
    _indices(world.materials.medium.ravel(), SAME_MEDIUM, len(world.media.g), f"{where}.materials.medium")
    _indices(world.lights.emitter_texture, -1, len(world.textures), f"{where}.lights.emitter_texture")
    _indices(world.lights.delta_texture, -1, len(world.textures), f"{where}.lights.delta_texture")
    _indices(world.lights.medium, -1, len(world.media.g), f"{where}.lights.medium")
    elements = len(world.lights.power)
    _require(len(world.emission.share) == elements, where, f"shares of {elements} light elements were expected")
    _require(0 <= world.seed < 2**32, where, f"seed {world.seed}")
    _require(world.max_depth is None or world.max_depth >= 1, where, f"max_depth {world.max_depth}")
    _require(math.isfinite(world.extent) and _positive(world.volume_unit), where, f"extent {world.extent}")
    _require(_positive(world.unit), where, f"unit {world.unit}")


def _map_plan(plan: MapPlan, where: str) -> None:
    lengths = _positive(plan.radius) and math.isfinite(plan.band) and plan.band >= 0
    _require(min(plan.paths, plan.point_set) >= 0 and lengths, where, f"{plan} is no plan of a map")


def _irradiance_plan(plan: IrradiancePlan, where: str) -> None:
    neighbours = min(plan.k, plan.caustic_k) >= 1 and max(plan.k, plan.caustic_k) <= MAX_K
    right = plan.share >= 0 and neighbours and math.isfinite(plan.reach) and min(plan.reach, plan.longest) >= 0
    _require(right, where, f"{plan} is no plan of irradiance")


def _photon_plan(plan: PhotonPlan, where: str) -> None:
    _require(0 <= plan.seed < 2**32, where, f"seed {plan.seed}")
    _require(_positive(plan.volume_unit), where, f"volume_unit {plan.volume_unit}")


def _lit_places(places: LitPlaces, where: str) -> None:
    finite = all(bool(np.isfinite(column).all()) for column in vars(places).values())
    positive = bool((places.power >= 0).all() and (places.radius > 0).all())
    _require(finite and positive and len(places) <= LARGEST_HEMISPHERE, where, "lit places that are none, or too many")


def _camera(camera: Camera, where: str) -> None:
    size = (camera.width, camera.height)
    _require(all(1 <= side <= LARGEST_SIDE for side in size), where, f"an image of {size} pixels")
    _require(bool(np.isfinite(camera.to_world).all()), where, "to_world is not finite")


def _pixel_filter(given: PixelFilter, where: str) -> None:
    _require(0 < given.radius <= LARGEST_FILTER and given.stddev > 0, where, f"a filter of radius {given.radius}")
    _require(0 <= given.b <= 1 and 0 <= given.c <= 1, where, f"a filter with b, c = {given.b}, {given.c}")


def _bitmap(bitmap: Bitmap, where: str) -> None:
    _require(bitmap.pixels.size > 0, where, f"texture {bitmap.name} has no pixels")


def _bucket_task(task: BucketTask, where: str) -> None:
    inside = 0 <= task.x0 < task.x1 <= LARGEST_SIDE and 0 <= task.y0 < task.y1 <= LARGEST_SIDE
    _require(task.number >= 0 and inside, where, f"{task} is no bucket")
    pixels = (task.x1 - task.x0) * (task.y1 - task.y0)
    _require(pixels <= LARGEST_BUCKET, where, f"a bucket of {pixels} pixels; at most {LARGEST_BUCKET} are taken")


def _photon_task(task: PhotonTask, where: str) -> None:
    _require(task.number >= 0 and 0 <= task.start < task.stop, where, f"{task} is no range of paths")
    _task_size(task.stop - task.start, where)


def _photons_traced(result: PhotonsTraced, where: str) -> None:
    _require(result.paths >= 0 and math.isfinite(result.emitted), where, f"{result} is no result")


def _bucket_rendered(result: BucketRendered, where: str) -> None:
    _require(len(result.layers) > 0, where, "a bucket without layers")


def _records(records: Records, where: str) -> None:
    finite = all(bool(np.isfinite(column).all()) for column in vars(records).values())
    _require(finite and bool((records.radius > 0).all()), where, "records that are not finite, or reach nowhere")
    _require(bool((records.error >= 0).all()), where, "records with an error below 0")


def _record_task(task: RecordTask, where: str) -> None:
    # Not the task itself: its places would be written out for each that is fine, which takes a millisecond or two.
    said = f"{task.start} to {task.stop} of round {task.round} is no range of candidates"
    _require(task.round >= 0 and 0 <= task.start < task.stop, where, said)
    _task_size(task.stop - task.start, where)
    some = task.some
    if some.ndim != 1 or not len(some):
        _require(some.ndim == 1, where, "candidates that are no list")
        return
    within = task.start <= some[0] and some[-1] < task.stop
    _require(bool(within and (np.diff(some) > 0).all()), where, "candidates outside its range, or not ascending")


def _task_size(size: int, where: str) -> None:
    _require(size <= LARGEST_TASK, where, f"a task of {size}; at most {LARGEST_TASK} are taken")


def _cache_plan(plan: CachePlan, where: str) -> None:
    whole = 0 <= plan.rounds <= 32 and 1 <= plan.spacing <= LARGEST_SIDE and plan.rows >= 1 and plan.columns >= 1
    whole = whole and 0 <= plan.left < plan.spacing and 0 <= plan.top < plan.spacing
    lengths = (
        _positive(plan.error)
        and _positive(plan.clearance)
        and _positive(plan.least)
        and _positive(plan.most)
        and math.isfinite(plan.wanted)
        and _positive(plan.tolerance)
        and math.isfinite(plan.extra)
        and plan.extra >= 0
        and _positive(plan.least_rays)
    )
    small = whole and lengths and math.prod(plan.strata(0)) * (1.0 + plan.extra) <= LARGEST_HEMISPHERE
    _require(small, where, f"{plan} is no plan of a cache")


def _partition(message: protocol.Partition, where: str) -> None:
    _require(0 <= message.part < message.parts, where, f"part {message.part} of {message.parts}")


MOST_PROCESSES = 4096
"""Of one slave: tasks in flight are counted by them."""


def _hello(hello: protocol.Hello, where: str) -> None:
    _require(len(hello.versions) <= 64, where, f"{len(hello.versions)} versions")
    _require(min(hello.threads, hello.memory, hello.own_memory, hello.process) >= 0, where, "a negative count")
    _require(1 <= hello.processes <= MOST_PROCESSES, where, f"{hello.processes} processes")
    names = [*hello.versions, *hello.versions.values(), hello.host]
    _require(max(map(len, names)) <= LONGEST_NAME, where, f"a name of more than {LONGEST_NAME} characters")
    _endpoint(hello.peers, f"{where}.peers")


def _endpoint(endpoint: str, where: str) -> None:
    """What it must look like in any transport; whether it is an address of one, that finds out."""
    right = "://" in endpoint and endpoint.isascii() and endpoint.isprintable() and len(endpoint) <= LONGEST_NAME
    _require(right, where, f"{endpoint!r:.80} is no endpoint")


def _setup(setup: protocol.Setup, where: str) -> None:
    slaves = sum(bool(peer) for peer in setup.peers)
    _require(slaves <= MOST_SLAVES, where, f"{slaves} slaves; at most {MOST_SLAVES} are connected with")
    for number, peer in enumerate(setup.peers):
        if peer:  # of the team
            _endpoint(peer, f"{where}.peers[{number}]")


def _build_maps(order: protocol.BuildMaps, where: str) -> None:
    sense = order.awaited >= 0 and 0 <= order.part < order.parts and len(order.regions) in (0, order.parts)
    _require(sense, where, f"{order.awaited} batches awaited, part {order.part} of {order.parts}")


def _copy(copy: protocol.Copy, where: str) -> None:
    _require(min(copy.cell, copy.slave, copy.epoch) >= 0, where, f"{copy} makes no sense")
    _endpoint(copy.endpoint, f"{where}.endpoint")


def _welcome(welcome: protocol.Welcome, where: str) -> None:
    times = _positive(welcome.heartbeat_s) and _positive(welcome.liveness_s)
    _require(welcome.number >= 0 and times, where, f"{welcome} makes no sense")


def _vitals(vitals: protocol.Vitals, where: str) -> None:
    rates = (vitals.cores, vitals.sent, vitals.received)
    sound = vitals.memory >= 0 and all(math.isfinite(rate) and rate >= 0 for rate in rates)
    _require(sound, where, f"{vitals} makes no sense")


def _slave_status(slave: protocol.SlaveStatus, where: str) -> None:
    counts = (slave.number, slave.process, slave.threads, slave.memory, slave.peak_memory, slave.team + 1, slave.cells)
    _require(min(*counts, slave.tasks, slave.done) >= 0, where, "a count is negative")
    sound = math.isfinite(slave.busy_s) and math.isfinite(slave.silent_s) and len(slave.host) <= LONGEST_NAME
    _require(sound, where, "a time is no number, or a name is too long")


def _status_report(report: protocol.StatusReport, where: str) -> None:
    counts = (report.units, report.done, report.images, report.expected, report.most, report.joined, report.lost)
    _require(min(*counts, report.refused, report.retried) >= 0, where, "a count is negative")
    sound = math.isfinite(report.phase_s) and len(report.phase) <= LONGEST_NAME
    _require(sound and len(report.slaves) <= MOST_SLAVES, where, "a time is no number, or a list is too long")


_RANGES: dict[type, Callable[[Any, str], None]] = {
    TopTree: check_top_tree,
    Outlines: check_outlines,
    Shapes: check_shapes,
    Instances: check_instances,
    LightTable: _lights,
    MaterialTable: _materials,
    Media: _media,
    Grids: _grids,
    MapPlan: _map_plan,
    World: _world,
    Steering: check_steering,
    IrradiancePlan: _irradiance_plan,
    PhotonPlan: _photon_plan,
    View: check_view,
    LightGuide: check_light_guide,
    CausticGuide: check_caustic_guide,
    Allotment: check_allotment,
    LampOutlines: check_lamp_outlines,
    LitPlaces: _lit_places,
    Camera: _camera,
    PixelFilter: _pixel_filter,
    Bitmap: _bitmap,
    Records: _records,
    RecordTask: _record_task,
    CachePlan: _cache_plan,
    BucketTask: _bucket_task,
    PhotonTask: _photon_task,
    PhotonsTraced: _photons_traced,
    BucketRendered: _bucket_rendered,
    Batch: check_whole,
    Runs: check_runs,
    protocol.Partition: _partition,
    protocol.Hello: _hello,
    protocol.Setup: _setup,
    protocol.Copy: _copy,
    protocol.BuildMaps: _build_maps,
    protocol.Welcome: _welcome,
    protocol.Vitals: _vitals,
    protocol.SlaveStatus: _slave_status,
    protocol.StatusReport: _status_report,
}
