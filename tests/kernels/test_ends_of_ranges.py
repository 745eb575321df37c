"""What kernels compute at the ends of their arguments' ranges: 0, 1, the floats beside them, nothing and infinity."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from texture_lookup import looked_up

from wdpm.kernels.lights import environment
from wdpm.kernels.lights.environment import Environment, _linear, environment_seen
from wdpm.kernels.materials import medium
from wdpm.kernels.materials.frames import bend, plain_frame, uv_frame
from wdpm.kernels.materials.fresnel import fresnel_metal
from wdpm.kernels.materials.medium import Media, free_path
from wdpm.kernels.materials.microfacet import clamped_alpha, sample_visible_normal
from wdpm.kernels.maths.directions import cosine_hemisphere, uniform_cone, uniform_sphere
from wdpm.scenes.model.textures import Bitmap, Interpolation

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BELOW_ONE = 1.0 - 2.0**-24
NUMBERS = (0.0, 2.0**-24, 2.0**-23, 0.5, 1.0 - 2.0**-23, BELOW_ONE)
"""Random numbers: the first, the last and some between."""


def uploaded(values: np.ndarray, dtype: type) -> wp.array:
    return wp.array(np.ascontiguousarray(values, np.float32), dtype=dtype, device="cpu")


@wp.kernel
def direction_kernel(u: wp.array[wp.vec2], direction_out: wp.array2d[wp.vec3]) -> None:
    i = wp.tid()
    direction_out[i, 0] = cosine_hemisphere(wp.vec3(0.0, 0.0, 1.0), u[i])
    direction_out[i, 1] = uniform_sphere(u[i])
    direction_out[i, 2] = uniform_cone(u[i], 2.0)


def test_directions_of_a_squares_border() -> None:
    """On the rim of the disc, whose squared radius is 1 but for roundings."""
    along = np.linspace(0.0, BELOW_ONE, 5001)
    border = [np.column_stack([along, np.full(len(along), end)]) for end in (0.0, BELOW_ONE)]
    u = np.concatenate([*border, *(side[:, ::-1] for side in border)])
    out = wp.empty((len(u), 3), dtype=wp.vec3, device="cpu")
    wp.launch(direction_kernel, len(u), inputs=[uploaded(u, wp.vec2)], outputs=[out], device="cpu")
    np.testing.assert_allclose(np.linalg.norm(out.numpy(), axis=2), 1.0, atol=1e-3)  # and no NaN
    assert (out.numpy()[:, 0, 2] >= 0).all()


@wp.kernel
def linear_kernel(u: wp.float32, a: wp.array[wp.float32], b: wp.array[wp.float32], x_out: wp.array[wp.float32]) -> None:
    i = wp.tid()
    x_out[i] = _linear(u, a[i], b[i])


@pytest.mark.parametrize("u", [0.0, 0.25, BELOW_ONE])
def test_patches_of_the_sky_of_any_radiance(u: float) -> None:
    """A density proportional to a (1 - x) + b x, however large or small a and b are: only their ratio counts."""
    a = np.array([1.0, 1.0, 3.0, 0.0, 1.0])
    b = np.array([1.0, 3.0, 1.0, 1.0, 0.0])
    root = np.sqrt(a * a * (1 - u) + b * b * u)
    expected = u * (a + b) / np.maximum(a + root, 1e-300)
    expected[a + root == 0.0] = 0.0
    for scale in (1e-35, 1e-25, 1.0, 1e25, 1e37):
        out = wp.empty(len(a), dtype=wp.float32, device="cpu")
        inputs = [u, uploaded(a * scale, wp.float32), uploaded(b * scale, wp.float32)]
        wp.launch(linear_kernel, len(a), inputs=inputs, outputs=[out], device="cpu")
        np.testing.assert_allclose(out.numpy(), expected, rtol=1e-5, atol=1e-7)


@wp.kernel
def pole_kernel(sky: Environment, direction: wp.array[wp.vec3], pdf_out: wp.array[wp.float32]) -> None:
    i = wp.tid()
    pdf_out[i] = environment_seen(sky, direction[i]).pdf


def test_the_poles_of_the_sky() -> None:
    """Where all columns meet: a direction along the map's axis has no density there, and no infinite one."""
    pixels = np.ones((4, 8, 3), np.float32)
    for axes in (np.eye(3), np.roll(np.eye(3), 1, axis=0)):
        sky = environment.upload(pixels, axes.astype(np.float32), "cpu")
        direction = np.concatenate([np.eye(3), -np.eye(3)])
        out = wp.empty(len(direction), dtype=wp.float32, device="cpu")
        wp.launch(pole_kernel, len(direction), inputs=[sky, uploaded(direction, wp.vec3)], outputs=[out], device="cpu")
        assert np.isfinite(out.numpy()).all()
        assert (out.numpy() == 0.0).sum() == 2


@wp.kernel
def facet_kernel(
    distribution: wp.int32,
    alpha: wp.vec2,
    seen_from: wp.array[wp.vec3],
    u: wp.array[wp.vec2],
    facet_out: wp.array[wp.vec3],
) -> None:
    i = wp.tid()
    facet_out[i] = sample_visible_normal(distribution, clamped_alpha(alpha), seen_from[i], u[i])


@pytest.mark.parametrize("distribution", [0, 1])
@pytest.mark.parametrize("alpha", [(0.0, 1e-3), (1e-8, 1e-8), (0.05, 0.2), (1.0, 1.0)])
def test_facets_of_the_last_random_numbers(distribution: int, alpha: tuple[float, float]) -> None:
    """Unit normals of the upper side, seen from straight above to grazing."""
    height = (1.0, BELOW_ONE, 0.9, 0.1, 1e-3, 1e-6, 1e-20)
    rows = [(h, a, x, y) for h in height for a in (0.0, 1.0, 2.5) for x in NUMBERS for y in NUMBERS]
    h, a, x, y = (np.array(column) for column in zip(*rows, strict=True))
    aside = np.sqrt(1.0 - h * h)
    seen_from = uploaded(np.column_stack([aside * np.cos(a), aside * np.sin(a), h]), wp.vec3)
    inputs = [distribution, wp.vec2(*alpha), seen_from, uploaded(np.column_stack([x, y]), wp.vec2)]
    out = wp.empty(len(rows), dtype=wp.vec3, device="cpu")
    wp.launch(facet_kernel, len(rows), inputs=inputs, outputs=[out], device="cpu")
    facet = out.numpy()
    np.testing.assert_allclose(np.linalg.norm(facet, axis=1), 1.0, atol=1e-5)
    assert (facet[:, 2] >= 0).all()


@wp.kernel
def metal_kernel(cosine: wp.array[wp.float32], index: wp.array[wp.vec2], reflectance_out: wp.array[wp.float32]) -> None:
    i = wp.tid()
    reflectance_out[i] = fresnel_metal(cosine[i], index[i][0], index[i][1])


def test_metals_without_index_or_at_grazing() -> None:
    """Sums that are divided by vanish for eta = k = 0 from straight above, and for eta = 1, k = 0 at grazing."""
    rows = [(c, eta, k) for c in (0.0, 1e-20, 0.5, BELOW_ONE, 1.0) for eta in (0.0, 1e-20, 1.0) for k in (0.0, 1e-20)]
    table = np.array(rows)
    out = wp.empty(len(rows), dtype=wp.float32, device="cpu")
    inputs = [uploaded(table[:, 0], wp.float32), uploaded(table[:, 1:], wp.vec2)]
    wp.launch(metal_kernel, len(rows), inputs=inputs, outputs=[out], device="cpu")
    reflectance = out.numpy()
    assert ((reflectance >= 0) & (reflectance <= 1)).all()  # and no NaN
    nothing = (table[:, 1:] == 0.0).all(axis=1)
    np.testing.assert_array_equal(reflectance[nothing], 1.0)
    np.testing.assert_array_equal(reflectance[table[:, 0] == 0.0], 1.0)


@wp.kernel
def frame_kernel(
    normal: wp.array[wp.vec3],
    du: wp.array[wp.vec3],
    bent_out: wp.array2d[wp.vec3],
    along_out: wp.array2d[wp.vec3],
) -> None:
    i = wp.tid()
    up = wp.vec3(0.0, 0.0, 1.0)
    f = bend(plain_frame(up), normal[i], wp.vec3(0.0))
    bent_out[i, 0] = f.s
    bent_out[i, 1] = f.t
    bent_out[i, 2] = f.n
    g = uv_frame(up, du[i], wp.vec3(0.0, 1.0, 0.0))
    along_out[i, 0] = g.s
    along_out[i, 1] = g.t
    along_out[i, 2] = g.n


def _frames(normal: np.ndarray, du: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    out = [wp.empty((len(normal), 3), dtype=wp.vec3, device="cpu") for _ in range(2)]
    inputs = [uploaded(normal, wp.vec3), uploaded(du, wp.vec3)]
    wp.launch(frame_kernel, len(normal), inputs=inputs, outputs=out, device="cpu")
    return out[0].numpy(), out[1].numpy()


def _assert_orthonormal(frames: np.ndarray) -> None:
    wide = frames.astype(np.float64)
    np.testing.assert_allclose(wide @ wide.transpose(0, 2, 1), np.broadcast_to(np.eye(3), wide.shape), atol=1e-5)


def test_normals_bent_onto_the_tangent() -> None:
    """Nothing of the old tangent is left across the new normal."""
    normal = np.array([[1.0, 0, 0], [-1, 0, 0], [1, 1e-8, 1e-8], [1e-3, 0, 0], [0, 1, 0]])
    bent, _ = _frames(normal, np.tile([1.0, 0, 0], (len(normal), 1)))
    _assert_orthonormal(bent)


def test_normals_of_any_length() -> None:
    """None, almost none, and beyond what float32 squares."""
    normal = np.array(
        [[0.0, 0, 0], [1e-30, 0, 1e-30], [1e30, 0, 1e30], [np.inf, 0, 1], [np.nan, 0, 1], [0.3, 0.2, 0.9]]
    )
    bent, _ = _frames(normal, np.tile([1.0, 0, 0], (len(normal), 1)))
    _assert_orthonormal(bent)


def test_tangents_that_say_nothing() -> None:
    """Along the normal, of no length, infinite, or no number: any frame about the normal serves."""
    du = np.array([[0.0, 0, 0], [0, 0, 1], [1e-12, 0, 1], [np.inf, 0, 0], [np.nan, 0, 0], [1e-25, 0, 0], [2, 0, 0]])
    _, along = _frames(np.tile([0.0, 0, 1], (len(du), 1)), du)
    _assert_orthonormal(along)


def test_coordinates_beyond_all_numbers_are_in_the_image() -> None:
    """Finite coordinates that a texture's own scale makes infinite."""
    pixels = np.random.default_rng(1).random((3, 3, 3)).astype(np.float32)
    scale = np.diag([1e3, 1e3, 1.0])
    bitmap = Bitmap("noise", pixels, interpolation=Interpolation.BILINEAR, to_uv=scale)
    uv = np.array([[3e38, 0.1], [-3e38, 0.1], [0.1, 3e38], [3e38, -3e38]], np.float32)
    colour = looked_up([bitmap], np.zeros(len(uv), np.int32), uv)
    assert ((colour >= pixels.min() - 1e-6) & (colour <= pixels.max() + 1e-6)).all()  # and no NaN


@wp.kernel
def free_path_kernel(media: Media, u: wp.array[wp.vec2], path_out: wp.array[wp.float32]) -> None:
    i = wp.tid()
    path_out[i] = free_path(media, 0, u[i][0], u[i][1])


@pytest.mark.parametrize("sigma_t", [0.0, 1e-30, 1.0, 1e30])
def test_free_paths_of_the_last_random_numbers(sigma_t: float) -> None:
    """Endless where nothing is, whatever the number; else a length, also for 0 and for 1."""
    u = np.array([(channel, number) for channel in (0.0, 0.5, 1.0) for number in (*NUMBERS, 1.0)])
    media = medium.upload_homogeneous(
        np.full((1, 3), sigma_t, np.float32), np.ones((1, 3), np.float32), np.zeros(1, np.float32), "cpu"
    )
    out = wp.empty(len(u), dtype=wp.float32, device="cpu")
    wp.launch(free_path_kernel, len(u), inputs=[media, uploaded(u, wp.vec2)], outputs=[out], device="cpu")
    if sigma_t == 0.0:
        np.testing.assert_array_equal(out.numpy(), np.inf)
    else:
        assert np.isfinite(out.numpy()).all()
        assert (out.numpy() >= 0).all()
