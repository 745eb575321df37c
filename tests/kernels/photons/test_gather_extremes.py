"""Gathers where one rounding, one photon or one place decides."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from gather_rig import F32, Photons, Queries, gather_all

from wdpm.kernels.constants import ADJOINT_BOUND
from wdpm.kernels.photons import kd_order
from wdpm.kernels.photons.gather import box_distance2, distance2_to
from wdpm.kernels.photons.photon_map import PhotonMap
from wdpm.scenes.errors import WdpmError

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

UP = np.array([0.0, 0.0, 1.0], F32)


def photons_at(position: np.ndarray, direction: np.ndarray = UP) -> Photons:
    """Photons of flux 1 on a floor that faces up."""
    count = len(position)
    return Photons(
        np.asarray(position, F32),
        np.ones((count, 3), F32),
        np.tile(UP, (count, 1)),
        np.tile(np.asarray(direction, F32), (count, 1)),
        np.arange(count, dtype=np.int64),
    )


def query_at(position: np.ndarray, shading: np.ndarray = UP) -> Queries:
    position = np.atleast_2d(np.asarray(position, F32))
    return Queries(position, np.tile(UP, (len(position), 1)), np.tile(np.asarray(shading, F32), (len(position), 1)))


def test_photons_just_as_far_as_the_radius_count() -> None:
    """On a lattice whose distances float32 holds exactly, against counting."""
    x, y = np.meshgrid(np.arange(-8, 9), np.arange(-8, 9))
    floor = photons_at(np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3) * 0.5).build()
    for radius in (1.0, 1.5, 2.5, 3.0):
        found = gather_all(floor, query_at([0.0, 0.0, 0.0]), 400, radius)
        assert found.count[0] == np.count_nonzero(x**2 + y**2 <= (2 * radius) ** 2)


@wp.kernel
def box_and_photon_kernel(
    photons: PhotonMap, query: wp.array[wp.vec3], box_out: wp.array[wp.float32], photon_out: wp.array[wp.float32]
) -> None:
    i = wp.tid()
    box_out[i] = box_distance2(photons.nodes, 0, query[i])[0]
    photon_out[i] = distance2_to(photons.leaves[0], photons.leaves[1], photons.leaves[2], query[i], wp.vec3(0.0))[0]


def test_a_box_without_extent_is_as_far_as_its_photon() -> None:
    """To the last bit: then boxes prune by what photons are ordered by, and no photon on a radius is lost."""
    rng = np.random.default_rng(1)
    count = 20_000
    place = rng.normal(size=3).astype(F32)
    tree = photons_at(np.tile(place, (8, 1))).build()
    query = wp.array((place + rng.normal(size=(count, 3))).astype(F32), dtype=wp.vec3, device="cpu")
    box, photon = (wp.empty(count, dtype=wp.float32, device="cpu") for _ in range(2))
    wp.launch(box_and_photon_kernel, count, inputs=[tree, query, box, photon], device="cpu")
    np.testing.assert_array_equal(box.numpy(), photon.numpy())


@pytest.mark.parametrize("arrival", [1e-7, 1e-5, 1e-3, 1e-1])
def test_no_normal_weighs_a_photon_up_without_bound(arrival: float) -> None:
    """A photon that arrives within `arrival` of grazing, where the shading normal leans towards it by 45 degrees."""
    grazing = np.array([np.sqrt(1 - arrival**2), 0.0, arrival])
    one = photons_at(np.zeros((1, 3)), grazing).build()
    leaning = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5)])
    found = gather_all(one, query_at(np.zeros(3), leaning), 1, 1.0)
    exact = min((leaning @ grazing) / arrival, 4.0)
    assert ADJOINT_BOUND == 4.0
    assert found.irradiance[0, 0] * np.pi == pytest.approx(exact, rel=1e-5)


def test_millions_of_photons_in_one_place_are_split_like_any_others() -> None:
    """Equal coordinates have an order, too: without one, each photon would be compared with each other one."""
    count = 2_000_000
    tree = photons_at(np.zeros((count, 3))).build()
    assert tree.count == count
    leaves = tree.rank.numpy()
    assert len(np.unique(leaves)) == count
    assert kd_order.LEAF_SIZE == 8
    found = gather_all(tree, query_at([[0.0, 0.0, 0.0]]), 50, 1.0)
    assert found.count[0] == 50


def test_photons_of_any_finite_flux_are_stored() -> None:
    """Together they may be more than float32 holds."""
    photons = photons_at(np.zeros((40, 3)))
    photons.flux[:20], photons.flux[20:] = np.float32(3e38), np.float32(-3e38)
    assert len(photons.build().leaves) > 0
    photons.flux[7, 1] = np.nan
    with pytest.raises(WdpmError, match=r"photon 7 has flux .* expected finite numbers"):
        photons.build()
