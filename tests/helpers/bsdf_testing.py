"""What tests of scattering functions share: probes that run them, a chi-square test, and Mitsuba's own values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy import stats

from wdpm.kernels.features import ALL, Features
from wdpm.kernels.materials.bsdf import make_bsdf
from wdpm.kernels.materials.types import RADIANCE, Bsdf

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Floats = NDArray[np.float32]
Wide = NDArray[np.float64]

BECKMANN, GGX = 0, 1


@dataclass(frozen=True, eq=False)
class Values:
    """Scattering functions and pdfs for pairs of directions.

    Attributes:
        diffuse: eval_diffuse, shape [N, 3].
        glossy, all: times |cos|, shape [N, 3].
        pdf_glossy, pdf_all: shape [N].
    """

    diffuse: Floats
    glossy: Floats
    all: Floats
    pdf_glossy: Floats
    pdf_all: Floats


@dataclass(frozen=True, eq=False)
class Samples:
    """Sampled directions; shapes [N, 3] and [N]. flags: delta, diffuse, straight, crosses, shape [N, 4]."""

    to: Floats
    weight: Floats
    pdf: Floats
    flags: NDArray[np.int32]


def material(kind: int, **values: object) -> Any:
    """A leaf with Mitsuba's defaults for what is not given. Colours may be numbers."""
    b = Bsdf()
    b.kind = kind
    defaults: dict[str, object] = {
        "color": 0.5,
        "specular": 1.0,
        "transmittance": 1.0,
        "eta": 1.5,
        "k": 0.0,
        "alpha": 0.0,
    }
    for name, value in (defaults | values).items():
        if name == "alpha":
            value = wp.vec2(*np.broadcast_to(np.asarray(value, np.float32), 2).tolist())
        elif name in defaults:
            value = wp.vec3(*np.broadcast_to(np.asarray(value, np.float32), 3).tolist())
        setattr(b, name, value)
    return b


@cache
def _kernels(features: Features) -> tuple[wp.Kernel, wp.Kernel]:
    functions = make_bsdf(features)
    has_diffuse = functions.has_diffuse
    eval_diffuse = functions.eval_diffuse
    eval_glossy = functions.eval_glossy
    eval_all = functions.eval_all
    pdf_glossy = functions.pdf_glossy
    pdf_all = functions.pdf_all
    sample_glossy = functions.sample_glossy
    sample_all = functions.sample_all
    even = functions.is_even
    reflectance = functions.reflectance
    grazing_gain = functions.grazing_gain

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def evaluate(
        b: Bsdf,
        w_from: wp.array[wp.vec3],
        w_to: wp.array[wp.vec3],
        mode: wp.int32,
        diffuse_out: wp.array[wp.vec3],
        glossy_out: wp.array[wp.vec3],
        all_out: wp.array[wp.vec3],
        pdf_glossy_out: wp.array[wp.float32],
        pdf_all_out: wp.array[wp.float32],
        gathered_out: wp.array[wp.bool],
        even_out: wp.array[wp.bool],
        reflectance_out: wp.array[wp.vec3],
        gain_out: wp.array[wp.float32],
    ):
        i = wp.tid()
        diffuse_out[i] = eval_diffuse(b, w_from[i], w_to[i])
        glossy_out[i] = eval_glossy(b, w_from[i], w_to[i], mode)
        all_out[i] = eval_all(b, w_from[i], w_to[i], mode)
        pdf_glossy_out[i] = pdf_glossy(b, w_from[i], w_to[i])
        pdf_all_out[i] = pdf_all(b, w_from[i], w_to[i])
        gathered_out[i] = has_diffuse(b)
        even_out[i] = even(b)
        reflectance_out[i] = reflectance(b, w_from[i])
        gain_out[i] = grazing_gain(b, w_from[i])

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def sample(
        b: Bsdf,
        w_from: wp.array[wp.vec3],
        u_lobe: wp.array[wp.float32],
        u: wp.array[wp.vec2],
        mode: wp.int32,
        glossy_only: wp.int32,
        to_out: wp.array[wp.vec3],
        weight_out: wp.array[wp.vec3],
        pdf_out: wp.array[wp.float32],
        flags_out: wp.array2d[wp.int32],
    ):
        i = wp.tid()
        s = sample_all(b, w_from[i], u_lobe[i], u[i], mode)
        if glossy_only == 1:
            s = sample_glossy(b, w_from[i], u_lobe[i], u[i], mode)
        to_out[i] = s.to
        weight_out[i] = s.weight
        pdf_out[i] = s.pdf
        flags_out[i, 0] = s.delta
        flags_out[i, 1] = s.diffuse
        flags_out[i, 2] = s.straight
        flags_out[i, 3] = s.crosses

    return evaluate, sample


def _array(values: object, dtype: Any, shape: tuple[int, ...]) -> wp.array:
    whole = np.broadcast_to(np.asarray(values, np.float32), shape)
    return wp.array(np.ascontiguousarray(whole), dtype=dtype, device="cpu")


def _evaluate(b: Any, w_from: object, w_to: object, mode: int, features: Features) -> list[NDArray[Any]]:
    """What the kernel puts out, in its order."""
    count = max(np.size(w_from), np.size(w_to)) // 3
    vectors = [_array(w, wp.vec3, (count, 3)) for w in (w_from, w_to)]
    kinds = (wp.vec3, wp.vec3, wp.vec3, wp.float32, wp.float32, wp.bool, wp.bool, wp.vec3, wp.float32)
    out = [wp.empty(count, dtype=kind, device="cpu") for kind in kinds]
    wp.launch(_kernels(features)[0], dim=count, inputs=[b, *vectors, mode], outputs=out, device="cpu")
    return [a.numpy() for a in out]


def evaluate(b: Any, w_from: object, w_to: object, mode: int = RADIANCE, features: Features = ALL) -> Values:
    """Values for pairs of directions; one of w_from and w_to may be a single direction."""
    return Values(*_evaluate(b, w_from, w_to, mode, features)[:5])


def is_gathered(b: Any, features: Features = ALL) -> bool:
    """has_diffuse."""
    up = direction(0.0)
    return bool(_evaluate(b, up, up, RADIANCE, features)[5].all())


def is_even(b: Any, features: Features = ALL) -> bool:
    """is_even."""
    up = direction(0.0)
    return bool(_evaluate(b, up, up, RADIANCE, features)[6].all())


def reflectances(b: Any, w_from: object, features: Features = ALL) -> Floats:
    """reflectance for directions, shape [N, 3]."""
    reflected: Floats = _evaluate(b, w_from, direction(0.0), RADIANCE, features)[7]
    return reflected


def grazing_gains(b: Any, w_from: object, features: Features = ALL) -> Floats:
    """grazing_gain for directions, shape [N]."""
    gained: Floats = _evaluate(b, w_from, direction(0.0), RADIANCE, features)[8]
    return gained


def sample(
    b: Any,
    w_from: object,
    u: object,
    u_lobe: object,
    mode: int = RADIANCE,
    glossy: bool = False,
    features: Features = ALL,
) -> Samples:
    """Samples of sample_all, or with `glossy` of sample_glossy; w_from and the random numbers may be single ones."""
    count = max(np.size(w_from) // 3, np.size(u) // 2, np.size(u_lobe))
    inputs = [
        b,
        _array(w_from, wp.vec3, (count, 3)),
        _array(u_lobe, wp.float32, (count,)),
        _array(u, wp.vec2, (count, 2)),
        mode,
        int(glossy),
    ]
    out = [wp.empty(count, dtype=kind, device="cpu") for kind in (wp.vec3, wp.vec3, wp.float32)]
    out.append(wp.empty((count, 4), dtype=wp.int32, device="cpu"))
    wp.launch(_kernels(features)[1], dim=count, inputs=inputs, outputs=out, device="cpu")
    return Samples(*(a.numpy() for a in out))


def random_samples(
    b: Any, w_from: object, count: int, seed: int, mode: int = RADIANCE, glossy: bool = False, features: Features = ALL
) -> Samples:
    """Independent samples."""
    rng = np.random.default_rng(seed)
    u, u_lobe = rng.random((count, 2), np.float32), rng.random(count, np.float32)
    return sample(b, w_from, u, u_lobe, mode, glossy, features)


def direction(theta: float, phi: float = 0.0) -> Floats:
    """A unit vector at an angle theta from z [degrees], turned by phi [degrees]."""
    t, p = np.radians(theta), np.radians(phi)
    return np.array([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], np.float32)


def random_directions(count: int, seed: int) -> Floats:
    """Unit vectors all around, shape [count, 3]."""
    v = np.random.default_rng(seed).normal(size=(count, 3))
    return (v / np.linalg.norm(v, axis=1, keepdims=True)).astype(np.float32)


def integrate(function: Callable[[Floats], NDArray[Any]], bands: int = 32, fine: int = 8) -> Wide:
    """Integrals of a function of direction over bins of the sphere, shape [bands, 2 bands, ...].

    Bins are equal in the angle to z and in azimuth, and sampled at fine x fine middles.
    """
    theta = (np.arange(bands * fine) + 0.5) * (np.pi / (bands * fine))
    phi = (np.arange(2 * bands * fine) + 0.5) * (np.pi / (bands * fine))
    t, p = np.meshgrid(theta, phi, indexing="ij")
    w = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)
    values = np.asarray(function(w.reshape(-1, 3).astype(np.float32)), np.float64)
    weights = np.sin(t).reshape(bands, fine, 2 * bands, fine, *[1] * (values.ndim - 1))
    cells = values.reshape(bands, fine, 2 * bands, fine, *values.shape[1:]) * weights
    return np.asarray(cells.sum(axis=(1, 3)) * (np.pi / (bands * fine)) ** 2)


def chi_square(to: Floats, pdf: Callable[[Floats], NDArray[Any]], bands: int = 32, fine: int = 8) -> float:
    """p-value of sampled directions [N, 3] against a pdf_solid_angle; zero vectors count as not sampled.

    Bins in which fewer than 10 samples are expected are put together, and so is what the pdf leaves to no direction.
    """
    sampled = np.any(to != 0, axis=1)
    v = to[sampled].astype(np.float64)
    theta = np.arctan2(np.hypot(v[:, 0], v[:, 1]), v[:, 2])
    turn = np.arctan2(v[:, 1], v[:, 0]) % (2 * np.pi)
    row = np.minimum((theta / np.pi * bands).astype(int), bands - 1)
    column = np.minimum((turn / np.pi * bands).astype(int), 2 * bands - 1)
    found = np.bincount(row * 2 * bands + column, minlength=2 * bands * bands).astype(np.float64)
    expected = integrate(pdf, bands, fine).ravel() * len(to)
    found = np.append(found, len(to) - sampled.sum())
    expected = np.append(expected, max(len(to) - expected.sum(), 0.0))
    order = np.argsort(expected)
    small = int(np.searchsorted(expected[order], 10.0))
    small = max(small, int(np.searchsorted(np.cumsum(expected[order]), 10.0)) + 1)
    first, rest = order[:small], order[small:]
    f = np.append(found[rest], found[first].sum())
    e = np.append(expected[rest], expected[first].sum())
    statistic = float(np.sum((f - e) ** 2 / e))
    return float(stats.chi2.sf(statistic, len(e) - 1))


def mitsuba_values(mi: Any, plugin: dict[str, Any], w_from: Floats, w_to: Floats) -> tuple[Wide, Wide]:
    """Mitsuba's eval [N, 3] (times |cos|) and pdf [N] of a BSDF for pairs of directions, mode RADIANCE."""
    bsdf = mi.load_dict(plugin)
    context = mi.BSDFContext()
    si = mi.SurfaceInteraction3f()
    si.sh_frame = mi.Frame3f([0, 0, 1])
    values, pdfs = [], []
    for a, b in zip(w_from.tolist(), w_to.tolist(), strict=True):
        si.wi = a
        value, pdf = bsdf.eval_pdf(context, si, b, True)
        values.append([value[0], value[1], value[2]])
        pdfs.append(pdf)
    return np.array(values), np.array(pdfs)
