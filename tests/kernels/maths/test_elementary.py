"""Elementary functions, against NumPy's and SciPy's in float64."""

from __future__ import annotations

import hashlib
from collections.abc import Callable

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray
from scipy import special

from wdpm.kernels.maths.elementary import (
    acos_of,
    atan2_of,
    erf_of,
    erfinv_of,
    exp_of,
    expm1_of,
    log1p_of,
    log_of,
    pow_of,
    sincos_of,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Floats = NDArray[np.float32]
Wide = NDArray[np.float64]

COUNT = 20000
ULPS = 0.51
"""Half an ulp is the rounding of the exact value."""

NAMES = ("sin", "cos", "exp", "expm1", "log", "log1p", "acos", "erf", "erfinv", "pow", "atan2")


@wp.kernel
def all_kernel(x: wp.array[wp.float32], y: wp.array[wp.float32], out: wp.array2d[wp.float32]):
    """Every function of x, and those of two arguments of (x, y), in the order of NAMES."""
    i = wp.tid()
    sc = sincos_of(x[i])
    out[0, i] = sc[0]
    out[1, i] = sc[1]
    out[2, i] = exp_of(x[i])
    out[3, i] = expm1_of(x[i])
    out[4, i] = log_of(x[i])
    out[5, i] = log1p_of(x[i])
    out[6, i] = acos_of(x[i])
    out[7, i] = erf_of(x[i])
    out[8, i] = erfinv_of(x[i])
    out[9, i] = pow_of(x[i], y[i])
    out[10, i] = atan2_of(x[i], y[i])


def run_all(x: Floats, y: Floats) -> dict[str, Floats]:
    out = wp.empty((len(NAMES), len(x)), dtype=wp.float32, device="cpu")
    arguments = [wp.array(np.ascontiguousarray(a), dtype=wp.float32, device="cpu") for a in (x, y)]
    wp.launch(all_kernel, dim=len(x), inputs=arguments, outputs=[out], device="cpu")
    return dict(zip(NAMES, out.numpy(), strict=True))


def call(name: str, x: object, y: object = 0.0) -> Floats:
    xs, ys = np.broadcast_arrays(np.asarray(x, np.float32), np.asarray(y, np.float32))
    return run_all(xs.ravel(), ys.ravel())[name]


def ulps(got: Floats, exact: Wide) -> float:
    """Largest error in units of the last place of the exact value, rounded to float32; subnormal results included."""
    assert np.isfinite(got).all()
    return float(np.max(np.abs(got - exact) / np.spacing(np.abs(exact).astype(np.float32)).astype(np.float64)))


def magnitudes(rng: np.random.Generator, low: float, high: float) -> Floats:
    """Numbers of either sign, even in the logarithm of their magnitude between 10^low and 10^high."""
    sign = rng.choice([-1.0, 1.0], COUNT)
    return (sign * 10.0 ** rng.uniform(low, high, COUNT)).astype(np.float32)


def near_one(rng: np.random.Generator) -> Floats:
    """Numbers in (-1, 1), many of them close to its ends, down to one ulp."""
    return np.clip(1.0 - np.abs(magnitudes(rng, -7.2, 0.3)), -1 + 2.0**-24, 1 - 2.0**-24).astype(np.float32)


UNARY: list[tuple[str, Callable[[Wide], Wide], Callable[[np.random.Generator], Floats]]] = [
    ("sin", np.sin, lambda rng: magnitudes(rng, -30, 5)),
    ("sin", np.sin, lambda rng: (rng.integers(-60000, 60000, COUNT) * (np.pi / 2)).astype(np.float32)),
    ("cos", np.cos, lambda rng: magnitudes(rng, -30, 5)),
    ("cos", np.cos, lambda rng: (rng.integers(-60000, 60000, COUNT) * (np.pi / 2)).astype(np.float32)),
    ("exp", np.exp, lambda rng: rng.uniform(-104.0, 88.72, COUNT).astype(np.float32)),
    ("exp", np.exp, lambda rng: magnitudes(rng, -30, 0)),
    ("expm1", np.expm1, lambda rng: magnitudes(rng, -30, 1.9)),
    ("log", np.log, lambda rng: np.abs(magnitudes(rng, -45, 38.5)) + np.float32(1e-45)),
    ("log", np.log, lambda rng: 1.0 + magnitudes(rng, -7, -0.1)),
    ("log1p", np.log1p, lambda rng: np.abs(magnitudes(rng, -30, 38))),
    ("log1p", np.log1p, lambda rng: -np.clip(np.abs(magnitudes(rng, -30, 0)), 0, 1 - 2.0**-24).astype(np.float32)),
    ("acos", np.arccos, near_one),
    ("acos", np.arccos, lambda rng: magnitudes(rng, -30, 0)),
    ("erf", special.erf, lambda rng: magnitudes(rng, -30, 1)),
    ("erf", special.erf, lambda rng: rng.uniform(-4.5, 4.5, COUNT).astype(np.float32)),
    ("erfinv", special.erfinv, near_one),
    ("erfinv", special.erfinv, lambda rng: np.clip(magnitudes(rng, -30, 0), -1 + 2.0**-24, 1 - 2.0**-24)),
]


@pytest.mark.parametrize(("name", "exact", "arguments"), UNARY)
def test_one_argument(
    name: str, exact: Callable[[Wide], Wide], arguments: Callable[[np.random.Generator], Floats]
) -> None:
    x = arguments(np.random.default_rng(1)).astype(np.float32)
    assert ulps(call(name, x), exact(x.astype(np.float64))) <= ULPS


def test_power() -> None:
    rng = np.random.default_rng(2)
    x = np.abs(magnitudes(rng, -20, 20))
    y = magnitudes(rng, -3, 2)
    with np.errstate(over="ignore", under="ignore"):
        exact = x.astype(np.float64) ** y.astype(np.float64)
    fits = (exact > 1e-45) & (exact < 3.4e38)
    assert fits.sum() > COUNT // 2
    assert ulps(call("pow", x[fits], y[fits]), exact[fits]) <= ULPS
    # Near 1 the logarithm is small and the exponent may be large.
    x = 1.0 + magnitudes(rng, -6, -2)
    y = magnitudes(rng, 0, 3)
    assert ulps(call("pow", x, y), x.astype(np.float64) ** y.astype(np.float64)) <= ULPS


def test_angle_of_a_point() -> None:
    rng = np.random.default_rng(3)
    y, x = magnitudes(rng, -10, 10), magnitudes(rng, -10, 10)
    assert ulps(call("atan2", y, x), np.arctan2(y.astype(np.float64), x)) <= ULPS
    turn = rng.uniform(-np.pi, np.pi, COUNT)
    y, x = np.sin(turn).astype(np.float32), np.cos(turn).astype(np.float32)
    assert ulps(call("atan2", y, x), np.arctan2(y.astype(np.float64), x)) <= ULPS


INF = np.inf
NAN = np.nan
PI = np.float32(np.pi)
HALF_PI = np.float32(np.pi / 2)
SPECIAL = {
    "sin": [((0.0,), 0.0), ((2e5,), NAN), ((INF,), NAN), ((NAN,), NAN)],
    "cos": [((0.0,), 1.0), ((-2e5,), NAN), ((-INF,), NAN), ((NAN,), NAN)],
    "exp": [((0.0,), 1.0), ((88.73,), INF), ((1e30,), INF), ((-104.1,), 0.0), ((-INF,), 0.0), ((INF,), INF)],
    "expm1": [((0.0,), 0.0), ((100.0,), INF), ((-1e9,), -1.0), ((-INF,), -1.0), ((NAN,), NAN)],
    "log": [((1.0,), 0.0), ((0.0,), -INF), ((-0.0,), -INF), ((INF,), INF), ((-1.0,), NAN), ((NAN,), NAN)],
    "log1p": [((0.0,), 0.0), ((-1.0,), -INF), ((INF,), INF), ((-1.5,), NAN), ((NAN,), NAN)],
    "acos": [((1.0,), 0.0), ((-1.0,), PI), ((1.5,), 0.0), ((-INF,), PI), ((0.0,), HALF_PI), ((NAN,), NAN)],
    "erf": [((0.0,), 0.0), ((4.0,), 1.0), ((-4.0,), -1.0), ((INF,), 1.0), ((-INF,), -1.0), ((NAN,), NAN)],
    "erfinv": [((0.0,), 0.0), ((1.0,), INF), ((-1.0,), -INF), ((1.1,), NAN), ((-INF,), NAN), ((NAN,), NAN)],
    "pow": [
        *[((0.0, 0.0), 1.0), ((INF, 0.0), 1.0), ((NAN, 0.0), 1.0), ((1.0, INF), 1.0), ((1.0, NAN), 1.0)],
        *[((0.0, 2.0), 0.0), ((0.0, -2.0), INF), ((INF, 2.0), INF), ((INF, -2.0), 0.0), ((-1.0, 2.0), NAN)],
        *[((2.0, INF), INF), ((2.0, -INF), 0.0), ((0.5, INF), 0.0), ((0.0, INF), 0.0), ((2.0, NAN), NAN)],
        *[((2.0, 127.0), 2.0**127), ((2.0, 128.0), INF), ((2.0, -149.0), 2.0**-149), ((2.0, -151.0), 0.0)],
        *[((3.0, 4.0), 81.0), ((9.0, 0.5), 3.0), ((NAN, 1.0), NAN)],
    ],
    "atan2": [
        *[((0.0, 0.0), 0.0), ((0.0, 1.0), 0.0), ((0.0, -1.0), PI), ((-0.0, -1.0), PI), ((1.0, 0.0), HALF_PI)],
        *[((-1.0, 0.0), -HALF_PI), ((INF, INF), np.float32(np.pi / 4)), ((-INF, 1.0), -HALF_PI), ((1.0, INF), 0.0)],
        *[((1.0, -INF), PI), ((1e-38, 1e38), 0.0), ((NAN, 1.0), NAN), ((1.0, NAN), NAN)],
    ],
}


@pytest.mark.parametrize("name", SPECIAL)
def test_zeros_infinities_and_the_rest(name: str) -> None:
    arguments = np.array([(*given, 0.0)[:2] for given, _ in SPECIAL[name]], np.float32)
    expected = np.array([value for _, value in SPECIAL[name]], np.float32)
    np.testing.assert_array_equal(call(name, arguments[:, 0], arguments[:, 1]), expected)


def test_the_same_bits_on_every_machine() -> None:
    """The digest was taken once: a machine or compiler that rounds differently breaks the exactness contract."""
    steps = np.arange(-20000.0, 20001.0)
    x = np.concatenate([steps / 160.0, steps / 20000.0]).astype(np.float32)
    y = np.roll(x, 12345)
    values = np.stack(list(run_all(x, y).values()))
    values[np.isnan(values)] = np.nan  # one NaN of the many
    assert hashlib.sha256(values.tobytes()).hexdigest()[:16] == "d330200a5ed13acc"
