"""The row of a triangle by its number, whatever triangles a cell holds."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from wdpm.kernels.rays.cell_triangles import Surfaces, row_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def find_rows(surfaces: Surfaces, prim: wp.array[wp.int32], row_out: wp.array[wp.int32]) -> None:
    """The row of each number."""
    i = wp.tid()
    row_out[i] = row_of(surfaces, prim[i])


def _rows(ids: list[int], prims: list[int]) -> list[int]:
    surfaces = Surfaces()
    surfaces.count = len(ids)
    surfaces.ids = wp.array(np.array(ids, np.int32), dtype=wp.int32, device="cpu")
    asked = wp.array(np.array(prims, np.int32), dtype=wp.int32, device="cpu")
    rows = wp.zeros(len(prims), dtype=wp.int32, device="cpu")
    wp.launch(find_rows, len(prims), inputs=[surfaces, asked, rows], device="cpu")
    return [int(row) for row in rows.numpy()]


@pytest.mark.parametrize(
    "ids",
    [
        [0],
        [41],
        list(range(50)),
        [i for i in range(60) if i not in (7, 8, 31)],
        [i for i in range(60) if i not in (0, 59)],
        list(range(100, 140)),
        list(range(3, 400, 4)),
        [0, 1, 2, 1000, 1001, 2_000_000_000],
    ],
    ids=["first", "alone", "all", "holes", "without ends", "late", "every fourth", "far apart"],
)
def test_every_triangle_is_found(ids: list[int]) -> None:
    assert _rows(ids, ids) == list(range(len(ids)))


def test_numbers_of_others_lead_to_some_row() -> None:
    """A peer that errs may name any number: what is read for it lies in the arrays all the same."""
    ids = [5, 6, 9, 12]
    assert all(0 <= row < len(ids) for row in _rows(ids, [-(2**31), -1, 0, 4, 7, 8, 13, 2**31 - 1]))
