"""Looks over a worker's shoulder while it traces one sample, and writes down what happens."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import SCHEMAS, Batch, Kind
from wdpm.cluster.work import parts
from wdpm.cluster.work.misses import start_paths
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.world import View
from wdpm.kernels import columns
from wdpm.kernels.camera.replayed_vertices import make_replay_vertices
from wdpm.kernels.materials.medium import DistanceSample
from wdpm.kernels.materials.surface import Surface
from wdpm.kernels.photons.deposits import CAUSTIC_MAP, GLOBAL_MAP
from wdpm.replaying.vertices import Collision, Gather, Hit, Onward, ReplayVertex, ShadowRay
from wdpm.scenes.flat.flatten import Origins
from wdpm.scenes.flat.material_table import LEAF_KINDS
from wdpm.scenes.flat.renderer_space import renderer_space
from wdpm.scenes.model.leaf_kind import BLACK as BLACK_KIND
from wdpm.scenes.model.scene import Scene

BLACK = (0.0, 0.0, 0.0)

LEAVES = {BLACK_KIND: "black"} | {number: kind.name for number, kind in LEAF_KINDS.items()}
"""Kinds of leaves by their numbers, for people."""


class Names:
    """What the things of a scene are called, and where its coordinates begin.

    Args:
        rendered: how many triangles the renderer kept of it.
    """

    def __init__(self, scene: Scene, rendered: int) -> None:
        self._scene = scene
        self._origins = Origins(scene)
        if len(self._origins) != rendered:
            raise AssertionError(f"{rendered} triangles are rendered, and {len(self._origins)} were expected")
        self.space = renderer_space(scene.meshes)

    def triangle(self, prim: int) -> tuple[str, str, int]:
        """Mesh, material and number in the mesh of a triangle."""
        number, row = self._origins.of(prim)
        mesh = self._scene.meshes[number]
        return mesh.name, self._scene.materials[mesh.material].name, row

    def medium(self, number: int) -> str | None:
        """Of a medium; None for none."""
        return None if number < 0 else self._scene.media[number].name


@dataclass(eq=False)
class _Vertex:
    """What was written down of a vertex: rows of SCHEMAS[PATH] that arrive and go on, shadow rays, gathers by map."""

    arrives: dict[str, Any]
    surface: Any
    flight: Any
    lights: list[int]
    carries: NDArray[np.float32]
    onward: dict[str, Any] | None
    gathers: dict[int, tuple[int, float, bool]] = field(default_factory=dict)


class Recorder:
    """Writes down one sample; an Observer of its worker (cluster.work.replica)."""

    def __init__(self, replica: Replica, view: View) -> None:
        self._replica = replica
        self._view = view
        self._vertices: list[_Vertex] = []
        self._lit: dict[tuple[int, int], tuple[float, float, float]] = {}
        self._passes: dict[tuple[int, int], int] = {}

    # What happens

    def shaded(self, scene: Any, orders: Any, rays: Any, shaded: Any) -> None:
        """The path has come to a vertex."""
        replica, count = self._replica, len(shaded.shots.slot)
        device = replica.launcher.device
        later = hasattr(rays, "bounce")
        arriving = rays if later else start_paths(replica, rays, 1)
        surface = wp.empty(1, dtype=Surface, device=device)
        flight = wp.empty(1, dtype=DistanceSample, device=device)
        light = wp.empty(count, dtype=wp.int32, device=device)
        replica.launcher(
            make_replay_vertices(replica.world.features),
            1,
            scene=scene,
            paths=arriving,
            orders=orders,
            surface_out=surface,
            flight_out=flight,
            light_out=light,
        )
        self._vertices.append(
            _Vertex(
                _row(arriving),
                surface.numpy()[0].copy(),
                flight.numpy()[0].copy(),
                [int(number) for number in light.numpy()],
                shaded.shots.radiance.numpy().copy(),
                None if shaded.paths.slot is None else _row(shaded.paths),
            )
        )

    def gathered(self, number: int, queries: Any, count: Any, radius: Any, truncated: Any) -> None:
        """Photons of a map were asked for at the last vertex; where they would count for nothing, they were not."""
        if not queries.weight.numpy().any():
            return
        reach = float(radius.numpy()[0]) * self._replica.world.unit
        found = int(count.numpy()[0]), reach, bool(truncated.numpy()[0])
        self._vertices[-1].gathers[number] = found

    def saw(self, batch: Batch) -> None:
        """A batch is about to be worked off."""
        if batch.kind is Kind.SHADOW_WALK_HIT:
            for part in self._parts(batch):
                self._passes[part] = self._passes.get(part, 0) + 1
        elif batch.kind is Kind.SAMPLES:
            self._lit[0, parts.EMISSION] = _rgb(batch.arrays["emission"][0])
            self._lit[0, parts.INDIRECT] = _rgb(batch.arrays["indirect"][0])
        elif batch.kind is Kind.LIT:
            for part, radiance in zip(self._parts(batch), batch.arrays["radiance"], strict=True):
                self._lit[part] = _rgb(radiance)

    def _parts(self, batch: Batch) -> list[tuple[int, int]]:
        """Of each item of a batch, the vertex and the part (cluster.work.parts) that it belongs to."""
        place, samples = batch.arrays["place"], self._view.light_samples
        return list(zip(parts.bounce_of(place, samples).tolist(), parts.part_of(place, samples).tolist(), strict=True))

    # What a replay shows of it

    def vertices(self, names: Names) -> tuple[ReplayVertex, ...]:
        """All vertices, and where a path leaves the scene what is beyond."""
        path = [self._vertex(bounce, vertex, names) for bounce, vertex in enumerate(self._vertices)]
        onward = path[-1].onward if path else None
        if not path or onward is not None:
            path.append(self._beyond(len(path), names))
        return tuple(path)

    def _vertex(self, bounce: int, vertex: _Vertex, names: Names) -> ReplayVertex:
        arrives = vertex.arrives
        return ReplayVertex(
            bounce,
            int(arrives["edges"]),
            names.medium(int(arrives["medium"])),
            _rgb(arrives["throughput"]),
            None if vertex.flight["scatters"] else self._hit(vertex, names),
            _collision(vertex, names) if vertex.flight["scatters"] else None,
            self._lit.get((bounce, parts.EMISSION), BLACK),
            self._shadow_rays(bounce, vertex),
            self._gather(bounce, vertex, GLOBAL_MAP, parts.INDIRECT),
            self._gather(bounce, vertex, CAUSTIC_MAP, parts.CAUSTIC),
            self._lit.get((bounce, parts.BEAM), BLACK),
            _onward(vertex, names),
        )

    def _beyond(self, bounce: int, names: Names) -> ReplayVertex:
        """Where the path ends without a hit."""
        camera = self._view.camera
        ray = self._vertices[-1].onward if self._vertices else None
        medium = -1 if camera.medium is None else camera.medium
        return ReplayVertex(
            bounce,
            1 if ray is None else int(ray["edges"]),
            names.medium(medium if ray is None else int(ray["medium"])),
            (1.0, 1.0, 1.0) if ray is None else _rgb(ray["throughput"]),
            None,
            None,
            self._lit.get((bounce, parts.EMISSION), BLACK),
            (),
            None,
            None,
            self._lit.get((bounce, parts.BEAM), BLACK),
            None,
        )

    def _hit(self, vertex: _Vertex, names: Names) -> Hit:
        arrives, surface = vertex.arrives, vertex.surface
        prim, t = int(arrives["prim"]), float(arrives["t"])
        mesh, material, triangle = names.triangle(prim)
        leaf = surface["bsdf"]
        return Hit(
            mesh,
            material,
            triangle,
            prim,
            _rgb(np.asarray(surface["position"], np.float64) * names.space.unit + names.space.center),
            float(arrives["u"]),
            float(arrives["v"]),
            t,
            t * float(np.linalg.norm(np.asarray(arrives["direction"], np.float64))) * names.space.unit,
            _rgb(surface["normal"]),
            _rgb(surface["shading_normal"]),
            bool(surface["front"] == 1),
            LEAVES[int(leaf["kind"])],
            _rgb(leaf["color"]),
            _rgb(leaf["specular"]),
            (float(leaf["alpha"][0]), float(leaf["alpha"][1])),
        )

    def _shadow_rays(self, bounce: int, vertex: _Vertex) -> tuple[ShadowRay, ...]:
        names, samples = self._replica.world.lights.names, self._view.light_samples
        return tuple(
            ShadowRay(
                None if light < 0 else names[light],
                _rgb(vertex.carries[j]),
                self._lit.get((bounce, j - samples)),
                self._passes.get((bounce, j - samples), 0),
            )
            for j, light in enumerate(vertex.lights)
        )

    def _gather(self, bounce: int, vertex: _Vertex, number: int, part: int) -> Gather | None:
        if number not in vertex.gathers:
            return None
        return Gather(*vertex.gathers[number], self._lit.get((bounce, part), BLACK))


def _collision(vertex: _Vertex, names: Names) -> Collision:
    arrives, distance = vertex.arrives, float(vertex.flight["t"])
    way = np.asarray(arrives["direction"], np.float64)
    position = np.asarray(arrives["origin"], np.float64) + distance * way / np.linalg.norm(way)
    space = names.space
    medium = names.medium(int(arrives["medium"])) or ""
    return Collision(medium, _rgb(position * space.unit + space.center), distance * space.unit)


def _onward(vertex: _Vertex, names: Names) -> Onward | None:
    onward = vertex.onward
    if onward is None or not (onward["throughput"] > 0).any():
        return None
    return Onward(
        _rgb(onward["direction"]),
        _rgb(onward["throughput"]),
        float(onward["pdf"]),
        names.medium(int(onward["medium"])),
    )


def _row(items: Any) -> dict[str, Any]:
    """The only item of a structure of arrays of paths, as it is now."""
    return {name: column[0].copy() for name, column in columns.download(items, SCHEMAS[Kind.PATH]).items()}


def _rgb(values: Any) -> tuple[float, float, float]:
    red, green, blue = (float(value) for value in values)
    return red, green, blue
