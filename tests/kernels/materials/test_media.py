"""Homogeneous media: transmittance, free paths and phase functions, against their formulas and Mitsuba's plugins."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray
from scipy import stats

from wdpm.kernels.materials import medium
from wdpm.kernels.materials.medium import (
    DistanceSample,
    Media,
    free_path,
    pass_weight,
    phase_sample,
    phase_value,
    scatter_weight,
    transmittance,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Floats = NDArray[np.float32]
Wide = NDArray[np.float64]

SIGMAS = np.array(
    [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [0.2, 1.0, 7.0], [0.0, 0.5, 3.0], [2.0, 0.0, 0.0], [1e-4, 1.0, 1e4]], np.float32
)
"""Extinction of the media under test: none, grey, coloured, and without any in some channels."""

G = np.array([-0.99, -0.7, -0.2, -1e-4, 0.0, 1e-20, 1e-4, 0.3, 0.85, 0.99])


@wp.func
def sample_distance(
    media: wp.ref[Media], medium: wp.int32, t_max: wp.float32, u_channel: wp.float32, u_distance: wp.float32
) -> DistanceSample:
    """A collision before t_max, or none.

    Args:
        t_max: distance to the end of the medium or the next surface; may be infinite.
        u_channel, u_distance: independent random numbers in [0, 1].
    """
    s = DistanceSample()
    t = free_path(media, medium, u_channel, u_distance)
    if t < t_max:
        s.t = t
        s.scatters = 1
        s.weight = scatter_weight(media, medium, t)
    else:
        s.t = t_max
        s.scatters = 0
        s.weight = pass_weight(media, medium, t_max)
    return s


@wp.kernel
def distance_kernel(
    media: Media,
    number: wp.array[wp.int32],
    t_max: wp.array[wp.float32],
    u: wp.array[wp.vec2],
    transmittance_out: wp.array[wp.vec3],
    t_out: wp.array[wp.float32],
    scatters_out: wp.array[wp.int32],
    weight_out: wp.array[wp.vec3],
):
    i = wp.tid()
    transmittance_out[i] = transmittance(media, number[i], t_max[i])
    s = sample_distance(media, number[i], t_max[i], u[i][0], u[i][1])
    t_out[i] = s.t
    scatters_out[i] = s.scatters
    weight_out[i] = s.weight


@wp.kernel
def phase_kernel(
    g: wp.array[wp.float32],
    cosine: wp.array[wp.float32],
    direction: wp.array[wp.vec3],
    u: wp.array[wp.vec2],
    value_out: wp.array[wp.float32],
    to_out: wp.array[wp.vec3],
):
    i = wp.tid()
    value_out[i] = phase_value(g[i], cosine[i])
    to_out[i] = phase_sample(g[i], direction[i], u[i])


def array(values: object, dtype: object) -> wp.array:
    return wp.array(np.ascontiguousarray(values), dtype=dtype, device="cpu")


def distances(sigma_t: Floats, number: object, t_max: object, u: object) -> tuple[Floats, Floats, NDArray, Floats]:
    """Transmittance over t_max, and t, scatters and weight of samples."""
    pairs = np.atleast_2d(np.asarray(u, np.float32))
    count = max(np.size(number), np.size(t_max), len(pairs))
    media = medium.upload_homogeneous(sigma_t, np.ones_like(sigma_t), np.zeros(len(sigma_t), np.float32), "cpu")
    inputs = [
        media,
        array(np.broadcast_to(np.asarray(number, np.int32), count), wp.int32),
        array(np.broadcast_to(np.asarray(t_max, np.float32), count), wp.float32),
        array(np.broadcast_to(pairs, (count, 2)), wp.vec2),
    ]
    out = [wp.empty(count, dtype=kind, device="cpu") for kind in (wp.vec3, wp.float32, wp.int32, wp.vec3)]
    wp.launch(distance_kernel, dim=count, inputs=inputs, outputs=out, device="cpu")
    through, t, scatters, weight = (a.numpy() for a in out)
    return through, t, scatters, weight


def phases(g: object, cosine: object, direction: object = (0.0, 0.0, 1.0), u: object = (0.5, 0.5)) -> list[Floats]:
    """Values of the phase function, shape [N], and sampled directions, shape [N, 3]."""
    count = max(np.size(g), np.size(cosine), np.size(direction) // 3, np.size(u) // 2)
    inputs = [
        array(np.broadcast_to(np.asarray(g, np.float32), count), wp.float32),
        array(np.broadcast_to(np.asarray(cosine, np.float32), count), wp.float32),
        array(np.broadcast_to(np.asarray(direction, np.float32), (count, 3)), wp.vec3),
        array(np.broadcast_to(np.asarray(u, np.float32), (count, 2)), wp.vec2),
    ]
    out = [wp.empty(count, dtype=kind, device="cpu") for kind in (wp.float32, wp.vec3)]
    wp.launch(phase_kernel, dim=count, inputs=inputs, outputs=out, device="cpu")
    return [a.numpy() for a in out]


def channel_midpoints(count: int, largest: float = 1.0) -> Wide:
    """Pairs of random numbers: each channel with `count` midpoints of [0, largest]."""
    u = (np.arange(count) + 0.5) / count * largest
    return np.stack([np.repeat([1 / 6, 1 / 2, 5 / 6], count), np.tile(u, 3)], axis=1)


def test_transmittance_is_exponential() -> None:
    depth = 10.0 ** np.linspace(-8, 4, 500)
    distance = depth.astype(np.float32)
    through, *_ = distances(SIGMAS, 2, distance, [0.5, 0.5])
    exact = np.exp(-(SIGMAS[2] * distance[:, None]).astype(np.float64))
    np.testing.assert_allclose(through, exact, rtol=1e-6, atol=1e-45)


def test_empty_space_and_infinite_distances() -> None:
    through, t, scatters, weight = distances(SIGMAS, -1, [0.0, 3.0, np.inf], [0.5, 0.9])
    np.testing.assert_array_equal(through, 1.0)
    np.testing.assert_array_equal(t, np.float32([0.0, 3.0, np.inf]))
    np.testing.assert_array_equal(scatters, 0)
    np.testing.assert_array_equal(weight, 1.0)
    number = np.arange(len(SIGMAS))
    through, *_ = distances(SIGMAS, number, np.inf, [0.5, 0.9])
    np.testing.assert_array_equal(through, (SIGMAS == 0.0).astype(np.float32))


@pytest.mark.parametrize("number", range(len(SIGMAS)))
@pytest.mark.parametrize("t_max", [1e-8, 1e-3, 0.7, 40.0, 1e4])
def test_free_paths_are_unbiased(number: int, t_max: float) -> None:
    """Means over the random numbers: the share that collides, the share that does not, and the collisions' distance."""
    sigma = SIGMAS[number].astype(np.float64)
    # Only random numbers up to `most` collide; the others need no more points.
    most = -np.expm1(-sigma.max() * t_max)
    if most > 0.0:
        _, t, scatters, weight = distances(SIGMAS, number, t_max, channel_midpoints(20000, most))
        collided = most * (weight * scatters[:, None]).mean(axis=0, dtype=np.float64)
        np.testing.assert_allclose(collided, -np.expm1(-sigma * t_max), rtol=2e-3, atol=2e-4 * most)
        moment = most * (weight * (scatters * t)[:, None]).mean(axis=0, dtype=np.float64)
        rate = np.maximum(sigma, 1e-30)
        depth = sigma * t_max
        exact = np.where(depth < 1e-3, sigma * t_max**2 / 2, (-np.expm1(-depth) - depth * np.exp(-depth)) / rate)
        np.testing.assert_allclose(moment, exact, rtol=2e-3, atol=2e-4 * most * t_max)
    _, _, scatters, weight = distances(SIGMAS, number, t_max, channel_midpoints(20000))
    through = (weight * (scatters == 0)[:, None]).mean(axis=0, dtype=np.float64)
    np.testing.assert_allclose(through, np.exp(-sigma * t_max), rtol=1e-5, atol=2e-4)


def test_extremes_stay_finite() -> None:
    rng = np.random.default_rng(1)
    ends = [0.0, 1e-30, 2.0**-24, 0.5, 1 - 2.0**-24, 1.0]
    u = np.array([(a, b) for a in (0.0, 0.34, 1.0) for b in ends])
    sigma = np.concatenate([SIGMAS, 10.0 ** rng.uniform(-20, 20, (200, 3)).astype(np.float32)])
    sigma[100:150, 1] = 0.0
    for t_max in (0.0, 1e-20, 1.0, 1e20, np.inf):
        number = np.repeat(np.arange(len(sigma)), len(u))
        _, t, scatters, weight = distances(sigma, number, t_max, np.tile(u, (len(sigma), 1)))
        assert np.isfinite(weight).all()
        assert (weight >= 0.0).all()
        assert weight.max() <= 3.00001
        np.testing.assert_array_equal(scatters == 1, t < np.float32(t_max))


def test_phase_function_is_normalised_and_its_mean_cosine_is_g() -> None:
    nodes, shares = np.polynomial.legendre.leggauss(400)
    # Crowd the nodes where the lobe is: cosine = 1 - 2 v^4, mirrored for backward lobes.
    v = (nodes + 1) / 2
    for g in G:
        toward = 1.0 if g >= 0 else -1.0
        cosine = (toward * (1 - 2 * v**4)).astype(np.float32)
        value = phases(g, cosine)[0].astype(np.float64)
        measure = 2 * np.pi * value * (8 * v**3) * shares / 2
        assert measure.sum() == pytest.approx(1.0, abs=2e-4)
        assert (measure * cosine).sum() == pytest.approx(g, abs=2e-4)


def test_phase_function_is_the_formula() -> None:
    cosine = np.linspace(-1, 1, 301).astype(np.float32)
    for g in G.astype(np.float32).astype(np.float64):
        exact = (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine.astype(np.float64)) ** 1.5)
        np.testing.assert_allclose(phases(g, cosine)[0], exact, rtol=2e-5)


def quantiles(g: float, count: int) -> Wide:
    """Cosines that cut Henyey and Greenstein's distribution into parts of about the same probability."""
    x = np.linspace(-1, 1, count + 1)
    cut = x if abs(g) < 1e-3 else (1 + g * g - ((1 - g * g) / (1 + g * x)) ** 2) / (2 * g)
    return np.concatenate([[-1.0], cut[1:-1], [1.0]])


@pytest.mark.parametrize("g", G)
def test_directions_follow_the_phase_function(g: float) -> None:
    rng = np.random.default_rng(7)
    count, rows, columns = 100000, 20, 12
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    to = phases(g, 0.0, direction, rng.random((count, 2)))[1].astype(np.float64)
    np.testing.assert_allclose(np.linalg.norm(to, axis=1), 1.0, atol=1e-6)

    cosine = np.clip(to @ direction, -1, 1)
    spread = np.sqrt((1 - g * g) / count) + 1e-7  # above one standard deviation of the mean
    assert cosine.mean() == pytest.approx(g, abs=5 * spread)

    side = np.cross(direction, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    turn = np.arctan2(to @ np.cross(direction, side), to @ side)
    edges = quantiles(g, rows)
    counts, *_ = np.histogram2d(cosine, turn, bins=(edges, np.linspace(-np.pi, np.pi, columns + 1)))
    nodes, shares = np.polynomial.legendre.leggauss(64)
    at = edges[:-1, None] + (edges[1:] - edges[:-1])[:, None] * (nodes + 1) / 2
    value = phases(g, at.ravel())[0].reshape(at.shape)
    probability = 2 * np.pi * (value @ shares) * (edges[1:] - edges[:-1]) / 2
    expected = count * np.repeat(probability[:, None] / columns, columns, axis=1)
    expected *= count / expected.sum()
    assert stats.chisquare(counts.ravel(), expected.ravel()).pvalue > 1e-4


def test_almost_isotropic_is_isotropic() -> None:
    u = np.random.default_rng(3).random((1000, 2))
    isotropic = phases(0.0, 0.0, u=u)[1]
    np.testing.assert_allclose(isotropic[:, 2], 2 * u[:, 0] - 1, atol=1e-6)
    for g in (1e-30, -1e-12, 1e-7):
        np.testing.assert_allclose(phases(g, 0.0, u=u)[1], isotropic, atol=2e-6)


@pytest.mark.parametrize("g", [-0.8, 0.0, 0.4, 0.95])
def test_equals_mitsuba(g: float) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    plugin = mi.load_dict({"type": "isotropic"} if g == 0.0 else {"type": "hg", "g": g})
    at = mi.MediumInteraction3f()
    before = np.array([0.6, 0.0, 0.8])
    at.wi = mi.Vector3f(-before)
    rng = np.random.default_rng(5)
    after = rng.normal(size=(100, 3))
    after /= np.linalg.norm(after, axis=1)[:, None]
    context = mi.PhaseFunctionContext(None)
    theirs = [plugin.eval_pdf(context, at, mi.Vector3f(d))[1] for d in after]
    np.testing.assert_allclose(phases(g, after @ before)[0], theirs, rtol=2e-4)
