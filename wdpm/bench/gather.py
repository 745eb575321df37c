"""How fast gathers and the building of photon maps are, next to scipy's cKDTree, in one run on one core.

The photons lie evenly on five faces of a unit box, as in the Cornell box. `coherent` queries are the pixels of a camera
that looks into it, row by row; `incoherent` ones are points in random order. cKDTree only finds the neighbours; ours
also filters them, and sums their flux.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from wdpm.kernels.photons import gather, photon_map
from wdpm.kernels.photons.gather_settings import check_settings
from wdpm.scenes.errors import WdpmError

Array = npt.NDArray[np.float32]

FACES = [(0, 0.0), (0, 1.0), (1, 0.0), (1, 1.0), (2, 0.0)]
"""Axis and coordinate of each face of the box; the sixth is open."""


@dataclass(frozen=True)
class Row:
    """One comparison.

    Attributes:
        work: what was timed.
        seconds: of ours, an item: a query, or a photon for a map.
        peer_seconds: of the peer, an item.
        peer: its name.
    """

    work: str
    seconds: float
    peer_seconds: float
    peer: str = "scipy cKDTree"

    @property
    def ratio(self) -> float:
        """How many times faster ours is."""
        return self.peer_seconds / self.seconds


def measure(
    photon_count: int = 250_000, k: int = 50, resolution: int = 200, rounds: int = 5, run: int = 16, seed: int = 0
) -> list[Row]:
    """Times gathers and building against scipy's cKDTree.

    The two are timed by turns and the best of each counts, so that a load that comes and goes does little harm.

    Args:
        photon_count: photons in the map.
        k: neighbours a query.
        resolution: the camera has resolution² pixels; as many queries are incoherent.
        rounds: times that each is timed.
        run: consecutive queries that a kernel thread handles.
        seed: of the photons and of the incoherent queries.

    Raises:
        WdpmError: scipy is not installed.
    """
    spatial = _scipy_spatial()
    check_settings(k, 1.0)
    rng = np.random.default_rng(seed)
    position, normal = _on_faces(rng, photon_count)
    flux = rng.random((photon_count, 3), dtype=np.float32)
    ids = np.arange(photon_count)

    def build() -> Any:
        return photon_map.build(position, flux, normal, normal, ids)

    def build_peer() -> Any:
        return spatial.cKDTree(position)

    photons, tree = build(), build_peer()
    rows = []
    for name, (x, n) in {"coherent": _camera(resolution), "incoherent": _on_faces(rng, resolution**2)}.items():
        ours = _gathers(photons, x, n, k, run)
        peer = _peer_gathers(tree, x, k)
        rows.append(_compare(f"{k} nearest of {photon_count:,} photons, {name}", ours, peer, len(x), rounds))
    rows.append(_compare(f"map of {photon_count:,} photons", build, build_peer, photon_count, rounds))
    return rows


def _scipy_spatial() -> ModuleType:
    try:
        import scipy.spatial
    except ImportError:
        raise WdpmError("bench: scipy is missing, which gathers are compared with: pip install scipy") from None
    spatial: ModuleType = scipy.spatial
    return spatial


def _gathers(photons: Any, x: Array, n: Array, k: int, run: int) -> Callable[[], None]:
    count = len(x)
    position, normal = (wp.array(column, dtype=wp.vec3, device="cpu") for column in (x, n))
    outputs = [wp.zeros(count, dtype=kind, device="cpu") for kind in (wp.vec3, wp.int32, wp.float32, wp.bool)]
    inputs = [photons, position, normal, normal, k, 1.0, 0.0, 0, run, *outputs]
    return lambda: wp.launch(gather.gather_kernel, dim=-(-count // run), inputs=inputs, device="cpu")


def _peer_gathers(tree: Any, x: Array, k: int) -> Callable[[], None]:
    return lambda: tree.query(x, k=k, workers=1)


def _compare(work: str, ours: Callable[[], object], peer: Callable[[], object], items: int, rounds: int) -> Row:
    ours()  # compiles
    times = [(_seconds(ours), _seconds(peer)) for _ in range(rounds)]
    best, peer_best = (min(column) for column in zip(*times, strict=True))
    return Row(work, best / items, peer_best / items)


def _seconds(function: Callable[[], object]) -> float:
    """Time on a core: what other processes took does not count, and both sides run on the thread that calls."""
    begin = time.thread_time()
    function()
    return time.thread_time() - begin


def _on_faces(rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Random points on the faces and their inward normals, shape [count, 3] each."""
    face = rng.integers(0, len(FACES), count)
    axis, side = np.array(FACES)[face].T
    point = rng.random((count, 3))
    rows, axis = np.arange(count), axis.astype(int)
    point[rows, axis] = side
    normal = np.zeros((count, 3))
    normal[rows, axis] = 1 - 2 * side
    return point.astype(np.float32), normal.astype(np.float32)


def _camera(resolution: int) -> tuple[Array, Array]:
    """What the pixels of a camera see that looks in through the open face, row by row: points and inward normals."""
    eye = np.array([0.5, 0.5, 2.4])
    grid = (np.arange(resolution) + 0.5) / resolution
    u, v = np.meshgrid(grid, grid)
    toward = np.stack([u, v, np.ones_like(u)], axis=-1).reshape(-1, 3) - eye  # through the open face, z = 1
    axes = np.array([axis for axis, _ in FACES])
    sides = np.array([side for _, side in FACES])
    with np.errstate(divide="ignore"):
        t = (sides - eye[axes]) / toward[:, axes]
    face = np.where(t > 1, t, np.inf).argmin(axis=1)  # the nearest plane behind the open face
    rows = np.arange(len(toward))
    point = eye + t[rows, face, None] * toward
    normal = np.zeros_like(point)
    normal[rows, axes[face]] = 1 - 2 * sides[face]
    return point.astype(np.float32), normal.astype(np.float32)
