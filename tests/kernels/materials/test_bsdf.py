"""Scattering functions: sampling against pdf, energy, reciprocity, closed forms, extreme arguments, pruned kernels."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bsdf_testing import (
    BECKMANN,
    GGX,
    Floats,
    Samples,
    chi_square,
    direction,
    evaluate,
    integrate,
    is_gathered,
    material,
    random_directions,
    random_samples,
    sample,
)
from scipy import stats

from wdpm.kernels.features import Features
from wdpm.kernels.materials.conductor import CONDUCTOR
from wdpm.kernels.materials.dielectric import DIELECTRIC
from wdpm.kernels.materials.plastic import PLASTIC
from wdpm.kernels.materials.principled import PRINCIPLED
from wdpm.kernels.materials.thin_dielectric import THIN_DIELECTRIC
from wdpm.kernels.materials.types import BLACK, DIFFUSE, FLUX, NULL, RADIANCE

COUNT = 60000
P_LEAST = 1e-4
"""Least p-value: seeds are fixed, so a test that passes once passes always."""

COPPER = {"eta": (0.2, 0.92, 1.10), "k": (3.91, 2.45, 2.14)}
PERFECT = {"eta": 0.0, "k": 1.0}

DELTA, DIFFUSE_PART, STRAIGHT, CROSSES = range(4)

MATERIALS: dict[str, Any] = {
    "diffuse": material(DIFFUSE, color=(0.2, 0.5, 0.9)),
    "copper ggx": material(CONDUCTOR, alpha=0.3, distribution=GGX, **COPPER),
    "copper beckmann": material(CONDUCTOR, alpha=0.3, distribution=BECKMANN, **COPPER),
    "brushed ggx": material(CONDUCTOR, alpha=(0.15, 0.6), distribution=GGX, **COPPER),
    "brushed beckmann": material(CONDUCTOR, alpha=(0.6, 0.15), distribution=BECKMANN, **COPPER),
    "frosted ggx": material(DIELECTRIC, alpha=0.3, distribution=GGX, specular=(0.9, 0.5, 0.3)),
    "frosted beckmann": material(DIELECTRIC, alpha=(0.2, 0.5), distribution=BECKMANN, transmittance=(0.9, 0.5, 0.3)),
    "bubble ggx": material(DIELECTRIC, alpha=(0.5, 0.2), distribution=GGX, eta=0.6),
    "dense beckmann": material(DIELECTRIC, alpha=0.25, distribution=BECKMANN, eta=2.5),
    "coated": material(
        PLASTIC, color=(0.2, 0.5, 0.9), alpha=0.25, distribution=GGX, eta=(1.5, 0.6, 0), transmittance=0, k=(1, 0, 0)
    ),  # internal reflectance 0.6, and a coat's transmittance (kernels/materials/plastic.py) by Fresnel's alone
    "principled": material(
        PRINCIPLED, color=(0.2, 0.5, 0.9), alpha=0.25, roughness=0.5, metallic=0.3, clearcoat=0.5, distribution=GGX
    ),
}
BOTH_SIDES = [name for name, b in MATERIALS.items() if b.kind == DIELECTRIC]
ANGLES = [
    *((name, theta) for name in MATERIALS for theta in (0.0, 50.0, 80.0)),
    *((name, 130.0) for name in BOTH_SIDES),
    *((name, 89.0) for name in MATERIALS if "copper" in name),
]


def means(s: Samples) -> np.ndarray:
    return s.weight.astype(np.float64).mean(axis=0)


@pytest.mark.parametrize(("name", "theta"), ANGLES)
def test_samples_follow_the_pdf(name: str, theta: float) -> None:
    b = MATERIALS[name]
    w_from = direction(theta, 30.0)
    s = random_samples(b, w_from, COUNT, seed=1)
    assert not s.flags[:, DELTA].any()
    assert chi_square(s.to, lambda w: evaluate(b, w_from, w).pdf_all) > P_LEAST


@pytest.mark.parametrize("mode", [RADIANCE, FLUX])
@pytest.mark.parametrize(("name", "theta"), ANGLES)
def test_weights_are_the_part_over_its_pdf(name: str, theta: float, mode: int) -> None:
    b = MATERIALS[name]
    w_from = direction(theta, 30.0)
    s = random_samples(b, w_from, 2000, seed=2, mode=mode)
    found = s.weight.max(axis=1) > 0
    assert found.mean() > 0.5
    to, weight, pdf, flags = s.to[found], s.weight[found], s.pdf[found], s.flags[found]
    v = evaluate(b, w_from, to, mode)
    np.testing.assert_allclose(np.linalg.norm(to, axis=1), 1, atol=2e-6)
    np.testing.assert_allclose(pdf, v.pdf_all, rtol=5e-3)
    np.testing.assert_allclose(flags[:, CROSSES], to[:, 2] * w_from[2] < 0)
    diffuse = v.diffuse * np.abs(to[:, 2:])
    np.testing.assert_allclose(v.all, diffuse + v.glossy, rtol=1e-5)
    is_diffuse = flags[:, DIFFUSE_PART] == 1
    # pdf_all = p cos / pi + (1 - p) pdf_glossy, and the weight is that of one part.
    cosine = np.maximum(to[:, 2], 0) / np.pi
    p = (v.pdf_all - v.pdf_glossy) / (cosine - v.pdf_glossy) if is_diffuse.any() else np.zeros(len(to))
    clear = np.abs(cosine - v.pdf_glossy) > 0.1 * (cosine + v.pdf_glossy)
    part = np.where(is_diffuse[:, None], diffuse, v.glossy)
    part_pdf = np.where(is_diffuse, p * cosine, (1 - p) * v.pdf_glossy)
    np.testing.assert_allclose(weight[clear], (part / part_pdf[:, None])[clear], rtol=1e-2)


@pytest.mark.parametrize(("name", "theta"), ANGLES)
def test_mean_weight_is_the_albedo_and_at_most_one(name: str, theta: float) -> None:
    b = MATERIALS[name]
    w_from = direction(theta, 30.0)
    s = random_samples(b, w_from, COUNT, seed=3, mode=FLUX)
    albedo = integrate(lambda w: evaluate(b, w_from, w, FLUX).all, fine=16).sum(axis=(0, 1))
    np.testing.assert_allclose(means(s), albedo, rtol=0.02, atol=2e-3)
    assert albedo.max() < 1.01


@pytest.mark.parametrize("alpha", [0.3, (0.02, 0.2), 1e-3])
@pytest.mark.parametrize("distribution", [GGX, BECKMANN])
def test_slopes_of_facets_scale_with_roughness(distribution: int, alpha: Any) -> None:
    """Seen from above, all facets are visible: the squared slope over alpha² has a closed cumulative distribution."""
    b = material(CONDUCTOR, alpha=alpha, distribution=distribution, **PERFECT)
    top = direction(0.0)
    rng = np.random.default_rng(20)
    s = sample(b, top, rng.random((COUNT, 2), np.float32), 0.5)
    m = s.to.astype(np.float64) + top
    sampled = s.pdf > 0
    t = np.sum((m[sampled, :2] / m[sampled, 2:] / np.broadcast_to(alpha, 2)) ** 2, axis=1)
    end = 1 / np.max(alpha) ** 2  # up to here no facet is steeper than 45 degrees, and reflects light down
    whole, upright = [1 - np.exp(-x) if distribution == BECKMANN else x / (1 + x) for x in (end, t[t < end])]
    assert stats.kstest(upright / whole, "uniform").pvalue > P_LEAST
    assert len(upright) / COUNT == pytest.approx(whole, abs=0.002)


@pytest.mark.parametrize("distribution", [GGX, BECKMANN])
@pytest.mark.parametrize("kind", [CONDUCTOR, DIELECTRIC])
def test_slightly_rough_surfaces_lose_nearly_nothing(kind: int, distribution: int) -> None:
    """Light is lost only where it would have to be scattered by two microfacets: the less, the smoother."""
    for alpha, lost in ((1e-2, 2e-3), (1e-3, 1e-3), (1e-5, 1e-3)):
        b = material(kind, alpha=alpha, distribution=distribution, **(PERFECT if kind == CONDUCTOR else {}))
        for theta in (0.0, 60.0):
            mean = means(random_samples(b, direction(theta), 5000, seed=4, mode=FLUX))
            assert np.all(mean <= 1 + 1e-6)
            assert np.all(mean > 1 - lost)


def test_reciprocity() -> None:
    """What a camera path sees is what a photon carries the other way: f(a, b) = adjoint f(b, a)."""
    a, b = random_directions(3000, 5), random_directions(3000, 6)
    apart = np.minimum(np.abs(a[:, 2]), np.abs(b[:, 2])) > 0.02
    a, b = a[apart], b[apart]
    for name, m in MATERIALS.items():
        if name == "principled":
            continue
        there = evaluate(m, a, b, RADIANCE).all / np.abs(b[:, 2:])
        back = evaluate(m, b, a, FLUX).all / np.abs(a[:, 2:])
        assert np.count_nonzero(there) > 1000, name
        np.testing.assert_allclose(there, back, rtol=5e-3, atol=1e-6, err_msg=name)


def exact_dielectric(cosine: np.ndarray, eta: float) -> np.ndarray:
    """Reflectance by the tangent and sine laws (Fresnel 1823), for light from outside."""
    i = np.arccos(cosine)
    t = np.arcsin(np.sin(i) / eta)
    return 0.5 * ((np.sin(i - t) / np.sin(i + t)) ** 2 + (np.tan(i - t) / np.tan(i + t)) ** 2)


def reflected_share(b: Any, w_from: Floats, mode: int = FLUX) -> float:
    """Share of u_lobe for which a smooth dielectric reflects."""
    u = (np.arange(20000) + 0.5) / 20000
    return 1 - sample(b, w_from, (0.5, 0.5), u, mode).flags[:, CROSSES].mean()


@pytest.mark.parametrize("eta", [1.5, 3.0, 1.01])
def test_smooth_dielectric_is_fresnel_and_snell(eta: float) -> None:
    b = material(DIELECTRIC, eta=eta)
    for theta in (5.0, 45.0, 75.0, 89.0):
        outside = direction(theta, 20.0)
        r = exact_dielectric(np.cos(np.radians(theta)), eta)
        assert reflected_share(b, outside) == pytest.approx(r, abs=1e-4)
        s = sample(b, outside, (0.5, 0.5), [0.0, 0.99999 if r < 0.9 else 1.0], FLUX)
        np.testing.assert_allclose(s.to[0], outside * [-1, -1, 1], atol=1e-6)
        np.testing.assert_allclose(s.to[1, :2], -outside[:2] / eta, atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(s.to, axis=1), 1, atol=1e-6)
        np.testing.assert_array_equal(s.weight, 1)
        np.testing.assert_array_equal(s.flags, [[1, 0, 0, 0], [1, 0, 0, 1]])
        np.testing.assert_array_equal(s.pdf, 0)
        # The way back is the same way with the same reflectance, and radiance changes by eta².
        inside = s.to[1]
        assert reflected_share(b, inside) == pytest.approx(r, abs=1e-4)
        np.testing.assert_allclose(sample(b, inside, (0.5, 0.5), 0.99999, FLUX).to[0], outside, atol=1e-4)
        for w, factor in ((outside, 1 / eta**2), (inside, eta**2)):
            np.testing.assert_allclose(sample(b, w, (0.5, 0.5), 0.99999).weight[0], factor, rtol=1e-6)


def test_known_reflectances() -> None:
    normal = direction(0.0)
    assert reflected_share(material(DIELECTRIC, eta=1.5), normal) == pytest.approx(0.04, abs=1e-4)
    brewster = direction(float(np.degrees(np.arctan(1.5))))
    perpendicular = ((1.5**2 - 1) / (1.5**2 + 1)) ** 2
    assert reflected_share(material(DIELECTRIC, eta=1.5), brewster) == pytest.approx(perpendicular / 2, abs=1e-4)
    mirror = sample(material(CONDUCTOR, **COPPER), normal, (0.5, 0.5), 0.5).weight[0]
    n, k = (np.array(COPPER[name]) for name in ("eta", "k"))
    np.testing.assert_allclose(mirror, ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2), rtol=1e-5)
    for theta in (0.0, 30.0, 70.0):  # a metal that does not absorb is a dielectric
        w = direction(theta)
        metal = sample(material(CONDUCTOR, eta=1.5, k=0.0), w, (0.5, 0.5), 0.5).weight[0, 0]
        assert metal == pytest.approx(reflected_share(material(DIELECTRIC, eta=1.5), w), abs=1e-4)


def test_total_reflection_is_total() -> None:
    critical = float(np.degrees(np.arcsin(1 / 1.5)))
    for theta in (critical + 0.01, 60.0, 89.9):
        assert reflected_share(material(DIELECTRIC, eta=1.5), direction(180 - theta)) == 1
        assert reflected_share(material(DIELECTRIC, eta=1 / 1.5), direction(theta)) == 1
        s = sample(material(DIELECTRIC, eta=1.5), direction(180 - theta), (0.5, 0.5), 1.0, glossy=True)
        np.testing.assert_array_equal(s.weight, 1)
    assert reflected_share(material(DIELECTRIC, eta=1.5), direction(180 - critical + 0.1)) < 0.9


def test_a_mirror_without_material_reflects_everything() -> None:
    w = random_directions(1000, 7)
    w[:, 2] = np.abs(w[:, 2])
    s = sample(material(CONDUCTOR, **PERFECT), w, (0.1, 0.9), 0.3)
    np.testing.assert_array_equal(s.weight, 1)
    np.testing.assert_array_equal(s.to, w * np.array([-1, -1, 1], np.float32))
    np.testing.assert_array_equal(s.flags, np.tile([1, 0, 0, 0], (1000, 1)))


def test_matched_indices_do_nothing() -> None:
    """eta = 1, whatever the roughness: light goes on as if there were nothing, in either direction."""
    w = random_directions(500, 8)
    for eta in (1.0, 1 + 1.2e-7):
        for alpha in (0.0, 0.5):
            s = random_samples(material(DIELECTRIC, eta=eta, alpha=alpha), w, 500, seed=9)
            np.testing.assert_allclose(
                s.to, -w, atol=6e-4 if eta > 1 else 0
            )  # bent most at grazing: by sqrt(2 (eta - 1))
            np.testing.assert_allclose(s.weight, 1, rtol=1e-6)
            assert np.all(s.flags == [1, 0, 0, 1])


def test_panes_and_boundaries() -> None:
    b = material(THIN_DIELECTRIC, eta=1.5, specular=0.5, transmittance=(0.2, 0.4, 0.6))
    for theta in (0.0, 60.0, 120.0):
        w = direction(theta, 10.0)
        r = exact_dielectric(np.maximum(np.abs(np.cos(np.radians(theta))), 1e-9) - 1e-9, 1.5)
        u = (np.arange(20000) + 0.5) / 20000
        s = sample(b, w, (0.5, 0.5), u)
        through = s.flags[:, CROSSES] == 1
        assert through.mean() == pytest.approx(1 - 2 * r / (1 + r), abs=1e-4)
        np.testing.assert_array_equal(s.to[through], np.tile(-w, (through.sum(), 1)))
        np.testing.assert_allclose(s.to[~through], np.tile(w * [-1, -1, 1], ((~through).sum(), 1)))
        np.testing.assert_array_equal(s.flags[through], np.tile([1, 0, 1, 1], (through.sum(), 1)))
        np.testing.assert_array_equal(s.flags[~through], np.tile([1, 0, 0, 0], ((~through).sum(), 1)))
        np.testing.assert_allclose(s.weight, np.where(through[:, None], (0.2, 0.4, 0.6), 0.5), rtol=1e-6)
    w = random_directions(100, 10)
    s = random_samples(material(NULL), w, 100, seed=11)
    np.testing.assert_array_equal(s.to, -w)
    np.testing.assert_array_equal(s.weight, 1)
    assert np.all(s.flags == [1, 0, 1, 1])
    s = random_samples(material(BLACK), w, 100, seed=11)
    assert not s.weight.any()
    assert not s.to.any()


def test_opaque_materials_are_black_behind() -> None:
    below = direction(120.0)
    w = random_directions(500, 12)
    for b in MATERIALS.values():
        if b.kind == DIELECTRIC:
            continue
        v = evaluate(b, below, w)
        assert not v.all.any()
        assert not random_samples(b, below, 500, seed=13).weight.any()
        assert not evaluate(b, w, below).all.any()


def test_photons_are_gathered_where_there_is_a_diffuse_part() -> None:
    for b in (material(DIFFUSE), material(PLASTIC), material(PRINCIPLED, metallic=0.5, spec_trans=0.5)):
        assert is_gathered(b)
    metal, glass = material(PRINCIPLED, metallic=1.0), material(PRINCIPLED, spec_trans=1.0)
    for b in (metal, glass, *(material(kind) for kind in (BLACK, CONDUCTOR, DIELECTRIC, THIN_DIELECTRIC, NULL))):
        assert not is_gathered(b)


def test_delta_lobes_have_no_value() -> None:
    w = random_directions(500, 14)
    for b in (material(CONDUCTOR), material(DIELECTRIC), material(THIN_DIELECTRIC), material(NULL), material(BLACK)):
        for to in (w * np.array([-1, -1, 1], np.float32), -w):
            v = evaluate(b, w, to)
            assert not v.all.any()
            assert not v.pdf_all.any()


def extreme_directions() -> Floats:
    """Random ones, and grazing ones down to the least float."""
    w = random_directions(3000, 15)
    for i, z in enumerate((1.0, 0.0, 1e-3, 1e-7, 1e-20, 1e-38, 1e-45)):
        w[200 * i : 200 * (i + 1), 2] = z
        w[200 * i + 100 : 200 * (i + 1), 2] = -z
    length = np.linalg.norm(w[:, :2].astype(np.float64), axis=1, keepdims=True)
    w[:, :2] *= np.sqrt(1 - np.minimum(w[:, 2:].astype(np.float64) ** 2, 1)) / length
    return w


def test_nothing_is_ever_infinite() -> None:
    """Roughness, index and angle at their ends: finite numbers, weights in bounds, unit directions."""
    w = extreme_directions()
    rng = np.random.default_rng(16)
    u, u_lobe = rng.random((len(w), 2), np.float32), rng.random(len(w), np.float32)
    ends = np.array([0.0, 2.0**-24, 0.5, 1 - 2.0**-24, 1.0], np.float32)
    u[::2] = rng.choice(ends, (len(w[::2]), 2))
    u_lobe[::3] = rng.choice(ends, len(w[::3]))
    kinds = [(CONDUCTOR, eta) for eta in (0.0, 1.0, 1.5)] + [
        (DIELECTRIC, e) for e in (1.0, 1 + 1e-7, 1.00001, 0.5, 3.0)
    ]
    for kind, eta in kinds:
        for alpha in (0.0, 1e-8, 1e-3, 0.2, 1.0, 10.0, (0.0, 0.3), (1.0, 1e-5)):
            for distribution in (BECKMANN, GGX):
                what = f"{kind} {eta} {alpha} {distribution}"
                b = material(kind, eta=eta, k=0.0, alpha=alpha, distribution=distribution)
                s = sample(b, w, u, u_lobe)
                for values in (s.to, s.weight, s.pdf):
                    assert np.all(np.isfinite(values)), what
                assert s.weight.min() >= 0, what
                assert s.weight.max() <= 1.0001 * max(1, eta, 1 / max(eta, 1)) ** 2 / min(1, eta or 1) ** 2, what
                found = s.weight.max(axis=1) > 0
                np.testing.assert_allclose(np.linalg.norm(s.to[found], axis=1), 1, atol=1e-5, err_msg=what)
                assert np.all(s.pdf[found & (s.flags[:, DELTA] == 0)] > 0), what
                for to in (s.to, w[::-1]):
                    v = evaluate(b, w, to)
                    for values in (v.all, v.pdf_all):
                        assert np.all(np.isfinite(values)), what
                        assert values.min() >= 0, what


PRUNED = {
    DIFFUSE: Features(),
    CONDUCTOR: Features(conductor=True),
    DIELECTRIC: Features(dielectric=True),
    THIN_DIELECTRIC: Features(thin_dielectric=True),
    PLASTIC: Features(plastic=True),
    PRINCIPLED: Features(principled=True, rough=True),
    NULL: Features(passing=True),
}


@pytest.mark.parametrize("kind", PRUNED)
def test_pruned_functions_have_the_same_bits(kind: int) -> None:
    w_from, w_to = random_directions(2000, 17), random_directions(2000, 18)
    features = PRUNED[kind]
    cases = [(material(kind, roughness=0.5, alpha=0.25 if features.rough else 0.0), features)]
    if kind in (CONDUCTOR, DIELECTRIC, PLASTIC):
        names = dict.fromkeys(features.names(), True)
        rough = Features(**names, rough=True)
        cases += [(material(kind, alpha=(0.2, 0.3), distribution=d), rough) for d in (BECKMANN, GGX)]
    for b, only in cases:
        for mode in (RADIANCE, FLUX):
            some, every = evaluate(b, w_from, w_to, mode, only), evaluate(b, w_from, w_to, mode)
            for name in vars(every):
                np.testing.assert_array_equal(getattr(some, name), getattr(every, name), err_msg=name, strict=True)
            for glossy in (False, True):
                few = random_samples(b, w_from, 2000, 19, mode, glossy, only)
                full = random_samples(b, w_from, 2000, 19, mode, glossy)
                for name in vars(full):
                    np.testing.assert_array_equal(getattr(few, name), getattr(full, name), err_msg=name, strict=True)
