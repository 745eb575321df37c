"""Camera rays against the formulas of pinhole, lens and parallel projection; pixel filters against their moments."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.camera import camera as kernel_camera
from wdpm.kernels.camera.camera import CameraView, make_camera, tangent
from wdpm.kernels.camera.pixel_filter import exponential, filter_quantiles
from wdpm.kernels.features import ALL, Features
from wdpm.scenes.model.scene import Camera, FilterKind, PixelFilter
from wdpm.scenes.model.transforms import look_at

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Array = NDArray[np.float64]
WIDTH, HEIGHT = 40, 30
PLAIN = Camera(look_at((1, 2, 3), (4, 1, -2), (0, 1, 0)), 50.0, WIDTH, HEIGHT, 0.5, 100.0)


PINHOLE = Features()


@functools.cache
def rays_kernel(features: Features) -> wp.Kernel:
    camera_ray = make_camera(features)

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def kernel(
        view: CameraView,
        pixel: wp.array[wp.int32],
        sample: wp.array[wp.int32],
        origin_out: wp.array[wp.vec3],
        direction_out: wp.array[wp.vec3],
        t_max_out: wp.array[wp.float32],
    ):
        i = wp.tid()
        ray = camera_ray(view, pixel[i], sample[i])
        origin_out[i] = ray.origin
        direction_out[i] = ray.direction
        t_max_out[i] = ray.t_max

    return kernel


def rays(camera: Camera, samples: int, seed: int = 0, features: Features = ALL) -> tuple[Array, Array, Array]:
    """Origins, directions and lengths of all samples of all pixels, shape [pixels, samples, ...]."""
    pixels = camera.width * camera.height
    count = pixels * samples
    outputs = [wp.empty(count, dtype=t, device="cpu") for t in (wp.vec3, wp.vec3, wp.float32)]
    pixel = np.repeat(np.arange(pixels, dtype=np.int32), samples)
    sample = np.tile(np.arange(samples, dtype=np.int32), pixels)
    inputs = [wp.array(a, dtype=wp.int32, device="cpu") for a in (pixel, sample)]
    view = kernel_camera.upload(camera, seed, "cpu")
    wp.launch(rays_kernel(features), count, inputs=[view, *inputs, *outputs], device="cpu")
    return tuple(out.numpy().astype(np.float64).reshape(pixels, samples, -1) for out in outputs)  # type: ignore[return-value]


def film_places(camera: Camera, samples: int, seed: int = 0) -> Array:
    """Where each ray passes the film, in pixels from its pixel's centre, shape [pixels, samples, 2]; by the formula.

    A point (x, y, 1) of camera space, +x to the left and +y up, is at column width (1/2 - x / (2 tan(fov / 2))), moved
    by the offset.
    """
    _, direction, _ = rays(camera, samples, seed)
    local = direction @ camera.to_world[:3, :3]  # a rotation's inverse is its transpose
    scale = camera.width / (2 * np.tan(np.radians(camera.fov_x) / 2))
    x = camera.width / 2 - local[..., 0] / local[..., 2] * scale + camera.principal_point[0] * camera.width
    y = camera.height / 2 - local[..., 1] / local[..., 2] * scale + camera.principal_point[1] * camera.height
    pixel = np.arange(camera.width * camera.height)
    centres = np.stack([pixel % camera.width + 0.5, pixel // camera.width + 0.5], axis=1)
    return np.asarray(np.stack([x, y], axis=2) - centres[:, None])


@pytest.mark.parametrize("fov", [1.0, 50.0, 140.0])
@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.25, -0.5)])
def test_samples_of_a_box_filter_lie_in_their_pixel(fov: float, offset: tuple[float, float]) -> None:
    places = film_places(replace(PLAIN, fov_x=fov, principal_point=offset), 16)
    # float32 directions: some 2^-22 of the image's width.
    slack = WIDTH * 2.0**-22 / min(1.0, np.tan(np.radians(fov) / 2))
    assert np.all(np.abs(places) <= 0.5 + slack)
    # 16 samples are one in each sixteenth of the pixel across and down.
    for axis in (0, 1):
        strata = np.sort(np.floor((places[..., axis] + 0.5) * 16), axis=1)
        assert (np.mean(strata == np.arange(16))) > 0.99  # but for the roundings


def test_rays_run_from_the_near_to_the_far_plane() -> None:
    origin, direction, t_max = rays(PLAIN, 2)
    forward = PLAIN.to_world[:3, 2]
    eye = PLAIN.to_world[:3, 3]
    np.testing.assert_allclose(direction @ forward, 1.0, atol=1e-6)
    np.testing.assert_allclose((origin - eye) @ forward, 0.5, atol=1e-6)
    np.testing.assert_allclose(np.cross(origin - eye, direction), 0.0, atol=1e-5)
    np.testing.assert_allclose(((origin + t_max * direction) - eye) @ forward, 100.0, rtol=1e-6)


def test_the_matrix_may_scale_and_the_image_stays() -> None:
    scaled = PLAIN.to_world.copy()
    scaled[:3, :3] *= 7.0
    for one, other in zip(rays(PLAIN, 2), rays(replace(PLAIN, to_world=scaled), 2), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6)


def truncated_gaussian_variance(radius: float, stddev: float) -> float:
    """Second moment of exp(-x² / 2 s²) - exp(-r² / 2 s²) on [-r, r], by quadrature."""
    x = np.linspace(-radius, radius, 200_001)
    density = np.exp(-(x**2) / (2 * stddev**2)) - np.exp(-(radius**2) / (2 * stddev**2))
    return float((x**2 * density).sum() / density.sum())


@pytest.mark.parametrize("radius", [0.25, 0.5, 4.0])
def test_a_box_filter_has_the_variance_of_its_width(radius: float) -> None:
    places = film_places(replace(PLAIN, filter=PixelFilter(FilterKind.BOX, radius)), 64)
    check_moments(places, radius, radius**2 / 3)


@pytest.mark.parametrize(("radius", "stddev"), [(4.0, 1.0), (0.5, 0.25), (5.0, 2.3)])
def test_a_gaussian_filter_has_its_moments(radius: float, stddev: float) -> None:
    places = film_places(replace(PLAIN, filter=PixelFilter(FilterKind.GAUSSIAN, radius, stddev)), 64)
    check_moments(places, radius, truncated_gaussian_variance(radius, stddev))


def test_samples_that_count_in_several_pixels_lie_evenly_in_their_own() -> None:
    check_moments(film_places(replace(PLAIN, filter=PixelFilter(FilterKind.GAUSSIAN, 2.0, 0.5)), 64), 0.5, 1 / 12)


def check_moments(places: Array, radius: float, variance: float) -> None:
    """1200 pixels x 64 samples: independent ones would leave sqrt(variance / 76,800) in the mean, and at most twice the
    relative deviation of sqrt(2 / 76,800) = 0.5 % in the variance; stratified ones are closer. Five of each."""
    flat = places.reshape(-1, 2)
    assert np.abs(flat).max() <= radius + 1e-4
    assert np.all(np.abs(flat.mean(axis=0)) < 5 * np.sqrt(variance / len(flat)))
    np.testing.assert_allclose((flat**2).mean(axis=0), variance, rtol=0.025)
    assert abs(np.corrcoef(flat.T)[0, 1]) < 5 / np.sqrt(len(flat))


def test_the_inverse_distribution_is_exact() -> None:
    """The share of a gaussian left of the table's entries is their place in the table."""
    radius, stddev = 2.0, 0.5
    table = filter_quantiles(PixelFilter(FilterKind.GAUSSIAN, radius, stddev)).astype(np.float64)
    np.testing.assert_array_equal(table[[0, -1]], [-radius, radius])
    assert np.all(np.diff(table) > 0)
    x = np.linspace(-radius, radius, 400_001)
    density = np.exp(-(x**2) / (2 * stddev**2)) - np.exp(-(radius**2) / (2 * stddev**2))
    share = np.interp(table, x, np.cumsum(density) / density.sum())
    np.testing.assert_allclose(share, np.linspace(0, 1, len(table)), atol=1e-5)


def test_seeds_and_pixels_have_their_own_samples() -> None:
    one, two = film_places(PLAIN, 4, seed=0), film_places(PLAIN, 4, seed=1)
    assert np.mean(np.abs(one - two) < 1e-4) < 0.01
    assert len(np.unique(np.round(one[:, 0], 4), axis=0)) > 0.99 * len(one)


LENS = replace(PLAIN, aperture_radius=0.3, focus_distance=4.0)
PARALLEL = replace(PLAIN, to_world=PLAIN.to_world @ np.diag([2.0, 3.0, 4.0, 1.0]), orthographic=True)


@pytest.mark.parametrize("camera", [PLAIN, LENS, PARALLEL], ids=["pinhole", "lens", "parallel"])
def test_a_crop_is_a_cut_out(camera: Camera) -> None:
    crop = replace(camera, crop=(8, 6, 20, 12), full_size=(WIDTH, HEIGHT), width=20, height=12)
    for whole, part in zip(rays(camera, 3), rays(crop, 3), strict=True):
        cut = whole.reshape(HEIGHT, WIDTH, 3, -1)[6:18, 8:28].reshape(part.shape)
        np.testing.assert_array_equal(part, cut)


@pytest.mark.parametrize(
    ("camera", "features"),
    [(PLAIN, PINHOLE), (LENS, Features(lens=True)), (PARALLEL, Features(orthographic=True))],
    ids=["pinhole", "lens", "parallel"],
)
def test_kernels_of_fewer_features_give_the_same_bits(camera: Camera, features: Features) -> None:
    for one, other in zip(rays(camera, 4, features=features), rays(camera, 4), strict=True):
        np.testing.assert_array_equal(one, other)


def test_rays_of_a_lens_cover_it_and_meet_in_the_plane_in_focus() -> None:
    origin, direction, t_max = rays(LENS, 64)
    _, pinhole, _ = rays(PLAIN, 64)
    eye, axes = LENS.to_world[:3, 3], LENS.to_world[:3, :3]
    np.testing.assert_allclose(direction @ axes[:, 2], 1.0, atol=1e-6)
    # In focus, a sample's ray is where that of the pinhole is.
    np.testing.assert_allclose(origin + direction * (4.0 - 0.5), eye + 4.0 * pinhole, atol=1e-5)
    np.testing.assert_allclose((origin - eye) @ axes[:, 2], 0.5, atol=1e-6)
    np.testing.assert_allclose(t_max, 99.5)
    on_lens = (origin - 0.5 * direction - eye) @ axes[:, :2] / 0.3
    radius2 = (on_lens**2).sum(axis=-1).ravel()
    angle = np.arctan2(on_lens[..., 1], on_lens[..., 0]).ravel()
    assert radius2.max() <= 1.0 + 1e-5
    # Uniform over a disk: radius² and angle are. 76,800 stratified samples: a tenth holds a tenth within 5 of the
    # deviations that independent ones would have.
    for share in (radius2, angle / (2 * math.pi) + 0.5):
        counts = np.histogram(share, 10, (0, 1 + 1e-5))[0]
        np.testing.assert_allclose(counts, len(share) / 10, atol=5 * math.sqrt(len(share) * 0.09))
    # The place on the lens has nothing to do with that in the pixel.
    places = film_places(PLAIN, 64)
    assert abs(np.corrcoef(on_lens[..., 0].ravel(), places[..., 0].ravel())[0, 1]) < 5 / math.sqrt(len(radius2))


def test_rays_of_an_orthographic_camera_are_parallel() -> None:
    origin, direction, t_max = rays(PARALLEL, 16)
    m = PARALLEL.to_world
    np.testing.assert_allclose(direction - m[:3, 2] / 4.0, 0.0, atol=1e-6)
    np.testing.assert_allclose(t_max, 99.5)
    local = np.linalg.solve(m, np.concatenate([origin, np.ones((*origin.shape[:2], 1))], axis=2)[..., None])[..., 0]
    pixel = np.arange(WIDTH * HEIGHT)
    x, y = WIDTH / 2 * (1 - local[..., 0]), HEIGHT / 2 - WIDTH / 2 * local[..., 1]
    assert np.abs(x - (pixel % WIDTH + 0.5)[:, None]).max() <= 0.5 + 1e-4
    assert np.abs(y - (pixel // WIDTH + 0.5)[:, None]).max() <= 0.5 + 1e-4
    np.testing.assert_allclose(local[..., 2], 0.5, atol=1e-5)


@pytest.mark.parametrize("plugin", ["thinlens", "orthographic"])
def test_mitsuba_sends_the_same_rays(plugin: str) -> None:
    """The ray through the middle of each pixel and (thinlens) the lens, from a crop."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    film = {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT}
    film |= {"crop_offset_x": 8, "crop_offset_y": 6, "crop_width": 20, "crop_height": 12}
    camera = PARALLEL if plugin == "orthographic" else LENS
    camera = replace(camera, crop=(8, 6, 20, 12), full_size=(WIDTH, HEIGHT), width=20, height=12)
    sensor = {"type": plugin, "near_clip": 0.5, "far_clip": 100.0, "film": film}
    sensor["to_world"] = mi.ScalarTransform4f(camera.to_world)
    if plugin == "thinlens":
        sensor |= {"fov": 50.0, "aperture_radius": 0.3, "focus_distance": 4.0}
    loaded = mi.load_dict(sensor)
    origin, direction, t_max = rays(replace(camera, filter=PixelFilter(FilterKind.BOX, 1e-6)), 2)
    for pixel in range(0, 240, 7):
        film_place = mi.Point2f((pixel % 20 + 0.5) / 20, (pixel // 20 + 0.5) / 12)
        on_lens = mi.Point2f(0.5, 0.5)
        theirs, _ = loaded.sample_ray(0.0, 0.5, film_place, on_lens)
        near, along = np.array(theirs.o), np.array(theirs.d)
        axis = camera.to_world[:3, 2] / np.linalg.norm(camera.to_world[:3, 2])
        if plugin == "orthographic":
            np.testing.assert_allclose(origin[pixel, 0], near, atol=2e-5)
            np.testing.assert_allclose(direction[pixel, 0], along, atol=1e-6)
            np.testing.assert_allclose(t_max[pixel, 0], theirs.maxt, rtol=1e-6)
        else:
            # Both pass the same place in focus.
            ours = origin[pixel] + direction[pixel] * 3.5
            place = near + along * (3.5 / (along @ axis))
            np.testing.assert_allclose(ours, np.broadcast_to(place, ours.shape), atol=2e-5)
            np.testing.assert_allclose(t_max[pixel, 0, 0], theirs.maxt * (along @ axis), rtol=1e-6)


def test_functions_of_the_host_are_right() -> None:
    for degrees in (1e-3, 0.5, 17.0, 45.0, 60.0, 89.0):
        assert tangent(degrees) == pytest.approx(
            math.tan(math.radians(degrees)), rel=2e-14 / math.cos(math.radians(degrees))
        )
    x = -np.geomspace(1e-9, 600.0, 1000)
    np.testing.assert_allclose(exponential(x), np.exp(x), rtol=600 * 2.0**-52)  # the exponent's own rounding
