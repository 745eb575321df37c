"""Which light reaches which part of the scene, as a render has learnt it (cluster.plan.light_guide).

Space is divided into regions, and the environment into tiles of patches. For each region a table says with which
probability a direction to the environment is looked for in each tile; within a tile it is chosen as ever, in proportion
to radiance. So the density is that of the unguided choice (environment.py) times a factor of region and tile.

Other tables say by which factor what a light may send to a place (tree.py) counts in each region, where there are
several lights.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.lights.environment import (
    Environment,
    EnvironmentSample,
    cumulative_shares,
    in_patch,
    patch_pdf,
    patch_weights,
    share_left,
)
from wdpm.kernels.rays import cells
from wdpm.kernels.rays.cells import Cells, cell_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

TILE_ROWS, TILE_COLUMNS = 16, 32
"""Tiles of an environment, at most: 11 degrees wide, about what a window seen across a room takes up."""

CONSTANT_NODES = (65, 128)
"""A constant environment is guided as a map of so many nodes."""


@wp.struct
class Guide:
    """What was learnt, on a device; of 0 regions where nothing was.

    Attributes:
        regions: the leaves of a kd-tree.
        starts: factors of where walks to a light start, heads first, [regions, choices of the light tree]; of no
            columns where none were learnt.
        distant: share of the lights infinitely far away up to and with each, [regions, lights].
        tiled: 1 where tiles of the environment were learnt; what follows is set only then.
        row_share: of a region, share of all rows of tiles up to and with each, [regions, rows].
        column_share: within a region and a row of tiles, up to and with each tile, [regions, rows * columns].
        factor: probability of a tile in a region over its probability without a guide, [regions, rows * columns].
        row_edge, column_edge: the first patch of each row and column of tiles, and one more past the last.
        row_tile, column_tile: the row and column of tiles of each row and column of patches.
        within_rows: share of a tile's rows of patches up to and with each, [columns, rows of patches].
        within_columns: share of a row of patches within a tile up to and with each patch, as the environment's.
    """

    regions: Cells
    starts: wp.array2d[wp.float32]
    distant: wp.array2d[wp.float64]
    tiled: wp.int32
    columns: wp.int32
    rows: wp.int32
    row_share: wp.array2d[wp.float32]
    column_share: wp.array2d[wp.float32]
    factor: wp.array2d[wp.float32]
    row_edge: wp.array[wp.int32]
    column_edge: wp.array[wp.int32]
    row_tile: wp.array[wp.int32]
    column_tile: wp.array[wp.int32]
    within_rows: wp.array2d[wp.float32]
    within_columns: wp.array2d[wp.float32]


def guided_pixels(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """The pixels of an environment as a guide divides them: a constant one has enough to be divided, too."""
    if pixels.shape[:2] == (1, 1):
        return np.ascontiguousarray(np.broadcast_to(pixels, (*CONSTANT_NODES, 3)))
    return pixels


def edges_of(pixels: NDArray[np.float32]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Guide.row_edge and column_edge of an environment's pixels (guided_pixels)."""
    rows, columns = pixels.shape[0] - 1, pixels.shape[1]
    across, down = min(TILE_COLUMNS, columns), min(TILE_ROWS, rows)
    row_edge = np.arange(down + 1) * rows // down
    column_edge = np.arange(across + 1) * columns // across
    return row_edge.astype(np.int32), column_edge.astype(np.int32)


def tiles_of(pixels: NDArray[np.float32]) -> tuple[int, int]:
    """Rows and columns of tiles of an environment's pixels (guided_pixels)."""
    row_edge, column_edge = edges_of(pixels)
    return len(row_edge) - 1, len(column_edge) - 1


class TiledSky:
    """An environment in tiles: what all guides of it have in common, each part of it worked out when it is asked for.

    Args:
        pixels: of the environment, of any size; [0, 0, 3] for none.

    Attributes:
        pixels: guided_pixels.
    """

    def __init__(self, pixels: NDArray[np.float32]) -> None:
        self.pixels = guided_pixels(pixels)

    @cached_property
    def edges(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Guide.row_edge and column_edge."""
        return edges_of(self.pixels)

    @cached_property
    def mass(self) -> NDArray[np.float64]:
        """Probability of each tile without a guide, shape [rows, columns]."""
        mass = _by_tile_row(self._weight_by_column, self.edges[0])
        total = float(np.cumsum(mass.reshape(-1))[-1])
        return mass / total if total > 0 else mass

    @cached_property
    def within_rows(self) -> NDArray[np.float32]:
        """Guide.within_rows."""
        return np.ascontiguousarray(_shares_within(self._weight_by_column.T, self.edges[0]))

    @cached_property
    def within_columns(self) -> NDArray[np.float32]:
        """Guide.within_columns."""
        return np.ascontiguousarray(_shares_within(self._weight, self.edges[1]))

    @cached_property
    def _weight(self) -> NDArray[np.float64]:
        return patch_weights(self.pixels)

    @cached_property
    def _weight_by_column(self) -> NDArray[np.float64]:
        return _by_tile_column(self._weight, self.edges[1])


def _by_tile_column(weight: NDArray[np.float64], edge: NDArray[np.int32]) -> NDArray[np.float64]:
    """Weight of each row of patches in each column of tiles."""
    return np.stack([np.cumsum(weight[:, a:b], axis=1)[:, -1] for a, b in pairwise(edge)], axis=1)


def _by_tile_row(weight: NDArray[np.float64], edge: NDArray[np.int32]) -> NDArray[np.float64]:
    return np.stack([np.cumsum(weight[a:b], axis=0)[-1] for a, b in pairwise(edge)])


def _shares_within(weight: NDArray[np.float64], edge: NDArray[np.int32]) -> NDArray[np.float32]:
    """cumulative_shares along the last axis, from anew at each edge."""
    parts = [cumulative_shares(weight[:, a:b]) for a, b in pairwise(edge)]
    return np.concatenate(parts, axis=1)


def upload(
    axis: NDArray[np.int32],
    split: NDArray[np.float32],
    chance: NDArray[np.float32],
    starts: NDArray[np.float32],
    distant: NDArray[np.float32],
    sky: TiledSky,
    device: str,
) -> Guide:
    """A guide on a device.

    Args:
        axis, split: of the regions' kd-tree, in heap order, as of the top tree.
        chance: probability of each tile in each region, shape [regions, rows, columns]; [regions, 0, 0] for no tiles.
        starts: Guide.starts.
        distant: share of each light infinitely far away, shape [regions, lights].
        sky: the environment that the tiles are of.
    """
    guide = Guide()
    guide.regions = cells.upload(axis, split, 0.0, device)
    guide.regions.count = len(chance)
    guide.starts = wp.array(np.ascontiguousarray(starts), dtype=wp.float32, device=device)
    shares = np.cumsum(distant.astype(np.float64), axis=1)
    if shares.size:
        shares /= shares[:, -1:]
    guide.distant = wp.array(shares, dtype=wp.float64, device=device)
    if not chance.size and len(chance):
        return guide
    row_edge, column_edge = sky.edges
    guide.tiled = 1
    guide.rows, guide.columns = tiles_of(sky.pixels)
    _upload_tiles(guide, chance, sky, device)
    numbers = {
        "row_edge": row_edge,
        "column_edge": column_edge,
        "row_tile": np.repeat(np.arange(guide.rows), np.diff(row_edge)),
        "column_tile": np.repeat(np.arange(guide.columns), np.diff(column_edge)),
    }
    for name, table in numbers.items():
        setattr(guide, name, wp.array(table.astype(np.int32), dtype=wp.int32, device=device))
    return guide


def _upload_tiles(guide: Any, chance: NDArray[np.float32], sky: TiledSky, device: str) -> None:
    """The tables of floats of a guide with tiles."""
    wide = chance.astype(np.float64).reshape(-1, guide.rows, guide.columns)
    factor = np.divide(wide, sky.mass, out=np.zeros_like(wide), where=sky.mass > 0).astype(np.float32)
    shape = (len(chance), guide.rows * guide.columns)
    tables = {
        "row_share": cumulative_shares(np.cumsum(wide, axis=2)[:, :, -1]),
        "column_share": cumulative_shares(wide.reshape(-1, guide.columns)).reshape(shape),
        "factor": factor.reshape(shape),
        "within_rows": sky.within_rows,
        "within_columns": sky.within_columns,
    }
    for name, table in tables.items():
        setattr(guide, name, wp.array(np.ascontiguousarray(table), dtype=wp.float32, device=device))


@wp.func
def region_of(guide: wp.ref[Guide], position: wp.vec3) -> wp.int32:
    """The region of a place; -1 without a guide."""
    if guide.regions.count == 0:
        return -1
    return cell_of(guide.regions, position)


@wp.func
def start_factor(guide: wp.ref[Guide], region: wp.int32, choice: wp.int32) -> wp.float32:
    """By which what a start of a walk to a light promises is multiplied; 1 without a guide."""
    if region < 0 or guide.starts.shape[1] == 0:
        return 1.0
    return guide.starts[region, choice]


@wp.func
def tile_of(guide: wp.ref[Guide], row: wp.int32, column: wp.int32) -> wp.int32:
    """The tile of a patch."""
    return guide.row_tile[row] * guide.columns + guide.column_tile[column]


@wp.func
def _search(shares: wp.array2d[wp.float32], line: wp.int32, first: wp.int32, end: wp.int32, u: wp.float32) -> wp.int32:
    """The first of some places in a line of shares whose share exceeds u; the last where none does."""
    low = first
    high = end - 1
    while low < high:
        middle = (low + high) // 2
        if shares[line, middle] <= u:
            low = middle + 1
        else:
            high = middle
    return low


@wp.func
def _left(
    shares: wp.array2d[wp.float32], line: wp.int32, first: wp.int32, found: wp.int32, u: wp.float32
) -> wp.float32:
    """Where u lies in the share that _search found, in [0, 1)."""
    before = wp.float32(0.0)
    if found > first:
        before = shares[line, found - 1]
    return share_left(u, before, shares[line, found])


@wp.func
def sample_guided(e: wp.ref[Environment], guide: wp.ref[Guide], region: wp.int32, u: wp.vec2) -> EnvironmentSample:
    """A direction to the environment: a tile by what the region has learnt, then a place in it by radiance."""
    row = _search(guide.row_share, region, 0, guide.rows, u[1])
    v = _left(guide.row_share, region, 0, row, u[1])
    first = row * guide.columns
    tile = _search(guide.column_share, region, first, first + guide.columns, u[0])
    h = _left(guide.column_share, region, first, tile, u[0])
    column = tile - first
    start = guide.row_edge[row]
    patch_row = _search(guide.within_rows, column, start, guide.row_edge[row + 1], v)
    v = _left(guide.within_rows, column, start, patch_row, v)
    start = guide.column_edge[column]
    patch_column = _search(guide.within_columns, patch_row, start, guide.column_edge[column + 1], h)
    h = _left(guide.within_columns, patch_row, start, patch_column, h)
    s = in_patch(e, patch_row, patch_column, h, v)
    s.pdf = s.pdf * guide.factor[region, tile]
    return s


@wp.func
def guided_seen(
    e: wp.ref[Environment], guide: wp.ref[Guide], region: wp.int32, direction: wp.vec3
) -> EnvironmentSample:
    """A direction as sample_guided would have made it."""
    patch = patch_pdf(e, direction)
    s = EnvironmentSample()
    s.direction = direction
    s.radiance = patch.radiance
    s.pdf = patch.pdf * guide.factor[region, tile_of(guide, patch.row, patch.column)]
    return s
