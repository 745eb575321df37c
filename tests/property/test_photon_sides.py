"""Photons where normals disagree: none gets to the other side, and none is divided by nothing."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from wdpm.cluster.render_settings import RenderSettings
from wdpm.kernels.constants import ADJOINT_BOUND
from wdpm.kernels.materials.surface import Surface
from wdpm.kernels.photons.shading_normals import adjoint_factor
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Camera, Mesh, Scene, diffuse
from wdpm.scenes.model.transforms import look_at

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@pytest.mark.parametrize("lean", [0.3, 1.0, 5.0])
def test_a_flat_floor_does_not_light_itself(lean: float) -> None:
    """Whatever its interpolated normals say: a photon that was scattered from it can only leave."""
    rng = np.random.default_rng(1)
    vertices = np.array([[-1.0, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]])
    normals = np.array([0.0, 1.0, 0.0]) + lean * rng.uniform(-1, 1, (4, 3)) * [1, 0, 1]
    floor = Mesh("floor", vertices, np.array([[0, 1, 2], [0, 2, 3]]), normals, None, 0)
    camera = Camera(look_at((0, 2, 0), (0, 0, 0), (0, 0, 1)), 50.0, 8, 8, near_clip=1e-3, far_clip=1e3)
    lamp = PointLight("lamp", (0.2, 0.7, 0.1), (1.0, 1.0, 1.0))
    what = Scene("floor", (floor,), (diffuse("white", (0.9, 0.9, 0.9), twosided=True),), (lamp,), camera)
    image = render_in_process(what, RenderSettings(photons=20_000, spp=4), workers=1, cells=1)
    assert image.layers["direct"].min() >= 0
    assert image.layers["direct"].max() > 0
    assert not image.layers["indirect"].any()


@wp.kernel
def factor_kernel(
    n: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    to_source: wp.array[wp.vec3],
    away: wp.array[wp.vec3],
    factor_out: wp.array[wp.float32],
) -> None:
    i = wp.tid()
    s = Surface()
    s.n = n[i]
    s.normal = normal[i]
    factor_out[i] = adjoint_factor(s, to_source[i], away[i])


def test_grazing_photons_have_finite_factors() -> None:
    """Directions exactly in the plane of either normal, and a float beside it: at most the bound of each side."""
    axis = np.eye(3)
    grazing = np.array([[1.0, 0, 0], [1, 0, 1e-38], [1, 0, 1e-7], [0.8, 0, 0.6]])
    rows = [(n, g, s, a) for n in axis for g in axis for s in grazing for a in grazing]
    columns = [np.array([row[k] for row in rows], np.float32) for k in range(4)]
    inputs = [wp.array(column, dtype=wp.vec3, device="cpu") for column in columns]
    out = wp.empty(len(rows), dtype=wp.float32, device="cpu")
    wp.launch(factor_kernel, len(rows), inputs=inputs, outputs=[out], device="cpu")
    factor = out.numpy()
    assert np.isfinite(factor).all()
    assert (factor >= 0).all()
    assert (factor <= ADJOINT_BOUND**2).all()
    in_plane = (columns[1] * columns[2]).sum(axis=1) == 0
    np.testing.assert_array_equal(factor[in_plane], 0.0)
