"""Camera rays as they set out, the paths that they begin, and what comes from beyond the scene where they end."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import SCHEMAS, Arrays, Batch, Kind, by_destination, take
from wdpm.cluster.rows import any_of, take_rows
from wdpm.cluster.runs import Numbers, Runs
from wdpm.cluster.work import parts
from wdpm.cluster.work.beams import start_beams
from wdpm.cluster.work.guards import EMISSION, Guards
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.world import View
from wdpm.kernels import columns
from wdpm.kernels.camera.paths import Paths
from wdpm.kernels.camera.rays import Rays
from wdpm.kernels.camera.vertices import Stretches


def no_hits(count: int, view: View) -> dict[str, NDArray[Any]]:
    """Best hits of camera rays that have met nothing yet."""
    return {
        # As camera_ray computes it: the difference of two float32, rounded once.
        "t": np.full(count, np.float32(view.camera.far_clip) - np.float32(view.camera.near_clip)),
        "prim": np.full(count, -1, np.int32),
        "u": np.zeros(count, np.float32),
        "v": np.zeros(count, np.float32),
        "owner": np.full(count, -1, np.int32),
    }


def first_cells(replica: Replica, rays: Any, count: int) -> NDArray[np.int32]:
    """The cell that each camera ray (kernels.camera.rays.Rays) comes to first, shape [count]."""
    if replica.world.top_tree.cells == 1:
        return np.zeros(count, np.int32)
    first = columns.integers(count, replica.launcher.device)
    kernel, camera = replica.kernels.first_camera_cells, replica.camera
    replica.launcher(kernel, count, camera=camera, cells=replica.cells, rays=rays, next_cell_out=first)
    cells: NDArray[np.int32] = first.numpy()
    return cells


def start_paths(replica: Replica, rays: Any, count: int) -> Any:
    """Camera rays (kernels.camera.rays.Rays) as the beginnings of paths (kernels.camera.paths.Paths)."""
    paths = columns.empty(Paths, count, replica.launcher.device)
    replica.launcher(replica.kernels.start_paths, count, camera=replica.camera, rays=rays, paths_out=paths)
    return paths


def missed_light(
    replica: Replica, guards: Guards, runs: Runs, cell: int, rays: Arrays, missed: NDArray[np.intp]
) -> Iterator[Batch]:
    """What rays that meet nothing bring home: light of the environment, and of the medium that they are in.

    In path tracing some of them collide in their medium: those are vertices of the cell that contains the collision.

    Args:
        guards: of camera samples.
        runs: whose they are, with their credit.
        cell: the cell where that became clear.
        rays: CAMERA rays, or rays of a PATH, among others.
        missed: the rows of those that meet nothing, ascending.
    """
    view, features = replica.view, replica.world.features
    if view is None or not features.misses:
        yield Batch(Kind.ENDED, cell, runs.without_rows(runs.credit), {})
        return
    rays = take(rays, missed)  # only here: where nothing lies beyond the scene, no row of them is read
    device, count = replica.launcher.device, len(missed)
    radiance = wp.empty(count, dtype=wp.vec3, device=device)
    stretches = columns.empty(Stretches, count if replica.outputs.media else 0, device)
    later = "bounce" in rays
    items = columns.upload(Paths if later else Rays, rays, device)
    paths = items if later else start_paths(replica, items, count)
    collision = columns.integers(count, device)
    replica.launcher(
        replica.kernels.path_misses,
        count,
        scene=replica.scene,
        paths=paths,
        orders=replica.orders(0),
        radiance_out=radiance,
        collision_out=collision,
        stretches_out=stretches,
    )
    follows = list(start_beams(replica, runs, stretches)) if features.media else []
    into = collision.numpy()
    if (into >= 0).any():
        follows += _collisions(runs, columns.download(paths, SCHEMAS[Kind.VERTEX]), into, view.light_samples)
    left = rest_of(runs, follows)
    if not left.any():  # all collide
        yield from follows
        return
    light = guards.blacken(radiance.numpy(), EMISSION, rays)
    rows = np.flatnonzero(any_of(light))
    none = np.zeros(len(rows), np.int32)
    bounce, diffuse = (rays["bounce"][rows], rays["diffuse"][rows]) if later else (none, none)
    lit = {
        "slot": rays["slot"][rows],
        "place": parts.place_of(bounce, diffuse, parts.EMISSION, view.light_samples),
        "radiance": take_rows(light, rows),
    }
    yield Batch(Kind.LIT, cell, runs.among(rows).with_credit(left), lit)
    yield from follows


def rest_of(runs: Runs, follows: Iterable[Batch]) -> Numbers:
    """What is left of the credit of some runs for what goes home, shape [runs].

    Args:
        follows: what else follows, its runs those of the same tasks one for one.
    """
    left = runs.credit.copy()
    for batch in follows:
        left -= batch.runs.credit
    return left


def _collisions(runs: Runs, paths: Arrays, into: NDArray[np.int32], light_samples: int) -> Iterator[Batch]:
    """Paths that collide in their medium on their way out of the scene, by the cell that contains the collision."""
    for cell, rows in by_destination(into, into >= 0):
        sent = take(paths, rows)
        mine = runs.among(rows)
        credit = parts.credit_of(mine, sent["bounce"], light_samples)
        yield Batch(Kind.VERTEX, cell, mine.with_credit(credit), sent)
