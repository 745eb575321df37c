"""Facets of random numbers at the ends of their range: 0, and the largest below 1."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from wdpm.kernels.microfacet import held_alpha, sample_visible_normal

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def facet_kernel(
    distribution: wp.int32,
    alpha: wp.vec2,
    seen_from: wp.array[wp.vec3],
    u: wp.array[wp.vec2],
    facet_out: wp.array[wp.vec3],
) -> None:
    i = wp.tid()
    facet_out[i] = sample_visible_normal(distribution, held_alpha(alpha), seen_from[i], u[i])


@pytest.mark.parametrize("distribution", [0, 1])
@pytest.mark.parametrize("alpha", [(0.0, 1e-3), (1e-8, 1e-8), (0.05, 0.2), (1.0, 1.0)])
def test_facets_of_the_last_random_numbers(distribution: int, alpha: tuple[float, float]) -> None:
    """Unit normals of the upper side, from straight above to grazing."""
    below_one = 1.0 - 2.0**-24
    numbers = (0.0, 2.0**-24, 2.0**-23, 0.5, 1.0 - 2.0**-23, below_one)
    height = np.array([1.0, 1.0 - 2.0**-24, 0.9, 0.1, 1e-3, 1e-6, 1e-20])
    rows = [(h, a, x, y) for h in height for a in (0.0, 1.0, 2.5) for x in numbers for y in numbers]
    h, a, x, y = (np.array(column) for column in zip(*rows, strict=True))
    aside = np.sqrt(1.0 - h * h)
    seen_from = np.column_stack([aside * np.cos(a), aside * np.sin(a), h]).astype(np.float32)
    u = np.column_stack([x, y]).astype(np.float32)
    inputs = [wp.array(seen_from, dtype=wp.vec3, device="cpu"), wp.array(u, dtype=wp.vec2, device="cpu")]
    out = wp.empty(len(rows), dtype=wp.vec3, device="cpu")
    wp.launch(facet_kernel, len(rows), inputs=[distribution, wp.vec2(*alpha), *inputs], outputs=[out], device="cpu")
    facet = out.numpy()
    np.testing.assert_allclose(np.linalg.norm(facet, axis=1), 1.0, atol=1e-5)
    assert (facet[:, 2] >= 0).all()
