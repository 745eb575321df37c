"""How fast rays find triangles, next to Embree, in one run on one core.

`coherent` rays are the pixels of a camera, row by row; `incoherent` ones are the random bounces of what those hit, in
random order. Embree is called through embreex, which traces one ray at a time on one thread, as a Warp launch does.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from wdpm.bench.gather import Row
from wdpm.kernels.rays.bvh import Bvh, any_hit, build, closest_hit, no_hit
from wdpm.scenes.errors import WdpmError

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Array = npt.NDArray[Any]


@wp.kernel
def closest_kernel(
    bvh: Bvh,
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    t_out: wp.array[wp.float32],
    prim_out: wp.array[wp.int32],
) -> None:
    """The nearest hit of each ray."""
    i = wp.tid()
    hit = closest_hit(bvh, origin[i], direction[i], no_hit())
    t_out[i] = hit.t
    prim_out[i] = hit.prim


@wp.kernel
def any_kernel(
    bvh: Bvh,
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    t_max: wp.float32,
    hit_out: wp.array[wp.bool],
) -> None:
    """Whether each ray hits anything before t_max."""
    i = wp.tid()
    hit_out[i] = any_hit(bvh, origin[i], direction[i], t_max)


def measure(triangles: Array | None = None, rays: int = 1_000_000, seconds: float = 3.0, seed: int = 0) -> list[Row]:
    """Times traversal against Embree.

    The two are timed by turns and the best of each counts, so that a load that comes and goes does little harm.

    Args:
        triangles: corners, shape [T, 3, 3]; by default a bumpy ball in a room, about 70,000 triangles.
        rays: pixels of the camera.
        seconds: how long each comparison goes on; each side is timed at least once.
        seed: of the bounces.

    Raises:
        WdpmError: embreex is not installed.
    """
    rtcore_scene, mesh_construction = _embree()
    triangles = _ball_in_room() if triangles is None else np.ascontiguousarray(triangles, dtype=np.float32)
    extent = float(np.linalg.norm(np.ptp(triangles, axis=(0, 1))))
    tree = build(triangles, np.arange(len(triangles), dtype=np.int32), extent * 2.0**-19)
    scene = rtcore_scene.EmbreeScene()
    mesh_construction.TriangleMesh(scene, triangles)

    rows = []
    coherent = _camera(triangles, rays)
    t, prim = _closest(tree, *coherent)()
    incoherent = _bounces(triangles, *coherent, t.numpy(), prim.numpy(), 1e-4 * extent, np.random.default_rng(seed))
    for name, (origin, direction) in {"coherent": coherent, "incoherent": incoherent}.items():
        if len(origin) == 0:
            continue  # the camera saw nothing that rays could bounce from
        work = f"closest hit in {len(triangles):,} triangles, {name}"
        peer = _peer(scene, origin, direction, "INTERSECT")
        rows.append(_compare(work, _closest(tree, origin, direction), peer, len(origin), seconds))
        work = f"any hit in {len(triangles):,} triangles, {name}"
        peer = _peer(scene, origin, direction, "OCCLUDED")
        rows.append(_compare(work, _any(tree, origin, direction), peer, len(origin), seconds))
    return rows


def _embree() -> tuple[ModuleType, ModuleType]:
    try:
        from embreex import mesh_construction, rtcore_scene
    except ImportError:
        raise WdpmError("bench: embreex is missing, which rays are compared with: pip install 'wdpm[peers]'") from None
    return rtcore_scene, mesh_construction


def _closest(tree: Any, origin: Array, direction: Array) -> Callable[[], tuple[wp.array, wp.array]]:
    rays = [wp.array(column, dtype=wp.vec3, device="cpu") for column in (origin, direction)]
    outputs = [wp.empty(len(origin), dtype=kind, device="cpu") for kind in (wp.float32, wp.int32)]

    def trace() -> tuple[wp.array, wp.array]:
        wp.launch(closest_kernel, len(origin), inputs=[tree, *rays, *outputs], device="cpu")
        return outputs[0], outputs[1]

    return trace


def _any(tree: Any, origin: Array, direction: Array) -> Callable[[], object]:
    rays = [wp.array(column, dtype=wp.vec3, device="cpu") for column in (origin, direction)]
    output = wp.empty(len(origin), dtype=wp.bool, device="cpu")
    return lambda: wp.launch(any_kernel, len(origin), inputs=[tree, *rays, 1.0e30, output], device="cpu")


def _peer(scene: Any, origin: Array, direction: Array, query: str) -> Callable[[], object]:
    return lambda: scene.run(origin, direction, query=query)


def _compare(work: str, ours: Callable[[], object], peer: Callable[[], object], rays: int, seconds: float) -> Row:
    ours()  # compiles
    best = peer_best = float("inf")
    end = time.perf_counter() + seconds
    while best == float("inf") or time.perf_counter() < end:
        best = min(best, _seconds(ours))
        peer_best = min(peer_best, _seconds(peer))
    return Row(work, best / rays, peer_best / rays, "Embree (embreex)")


def _seconds(function: Callable[[], object]) -> float:
    """Time on a core: what other processes took does not count, and both sides run on the thread that calls."""
    begin = time.thread_time()
    function()
    return time.thread_time() - begin


def _ball_in_room() -> Array:
    """A bumpy ball of 2 x 185² triangles in a closed room; shape [T, 3, 3]."""
    polar, around = np.meshgrid(np.linspace(0, np.pi, 186), np.linspace(0, 2 * np.pi, 186))
    radius = 1 + 0.1 * np.sin(9 * polar) * np.sin(7 * around) + 0.02 * np.sin(40 * polar) * np.sin(50 * around)
    sine = np.sin(polar)
    ball = np.stack([radius * sine * np.cos(around), radius * np.cos(polar), radius * sine * np.sin(around)], axis=-1)
    room = []
    square = np.array([[-2.5, -2.5], [2.5, -2.5], [2.5, 2.5], [-2.5, 2.5]])
    for axis in range(3):
        for side in (-2.5, 2.5):
            face = np.insert(square, axis, side, axis=1)
            room += [face[[0, 1, 2]], face[[0, 2, 3]]]
    return np.concatenate([_grid_triangles(ball), np.array(room)]).astype(np.float32)


def _grid_triangles(points: Array) -> Array:
    """Two triangles for each square of a grid of points [m, n, 3]."""
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    return np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]).reshape(-1, 3, 3)


def _camera(triangles: Array, rays: int) -> tuple[Array, Array]:
    """About `rays` pixels of a camera near the edge of the scene that looks at its middle, row by row."""
    low, high = triangles.min(axis=(0, 1)).astype(float), triangles.max(axis=(0, 1)).astype(float)
    middle = (low + high) / 2
    eye = middle + 0.45 * (high - low) * np.array([0.2, 0.4, 1.0])
    forward = (middle - eye) / np.linalg.norm(middle - eye)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    side = max(1, round(rays**0.5))
    x, y = np.meshgrid(*2 * [(np.arange(side) + 0.5) / side * 2 - 1])
    direction = forward + 0.7 * (x.reshape(-1, 1) * right - y.reshape(-1, 1) * up)
    origin = np.broadcast_to(eye, direction.shape)
    return np.ascontiguousarray(origin, dtype=np.float32), direction.astype(np.float32)


def _bounces(
    triangles: Array, origin: Array, direction: Array, t: Array, prim: Array, offset: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Cosine-distributed rays from `offset` above what was hit, in random order."""
    seen = rng.permutation(np.flatnonzero(prim >= 0))
    a, b, c = triangles[prim[seen]].astype(float).swapaxes(0, 1)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= -np.sign((normal * direction[seen]).sum(axis=1, keepdims=True))
    point = origin[seen] + t[seen, None] * direction[seen] + offset * normal
    lobe = rng.normal(size=normal.shape)
    bounce = normal + lobe / np.linalg.norm(lobe, axis=1, keepdims=True)
    return point.astype(np.float32), bounce.astype(np.float32)
