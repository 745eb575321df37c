"""Scattering functions against Mitsuba 3's plugins of the same names: values, pdfs, and samples of delta lobes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bsdf_testing import BECKMANN, GGX, direction, evaluate, material, mitsuba_values, random_directions, sample

from wdpm.kernels.materials.conductor import CONDUCTOR
from wdpm.kernels.materials.dielectric import DIELECTRIC
from wdpm.kernels.materials.thin_dielectric import THIN_DIELECTRIC
from wdpm.kernels.materials.types import DIFFUSE

NAMES = {BECKMANN: "beckmann", GGX: "ggx"}
ROUGHNESS = [(0.5, 0.5), (0.1, 0.3), (0.9, 0.05)]

COPPER = {"eta": (0.2, 0.92, 1.10), "k": (3.91, 2.45, 2.14)}
REFLECTS = (0.9, 0.6, 0.3)
TRANSMITS = (0.5, 0.7, 0.8)


@pytest.fixture(scope="module")
def mi() -> Any:
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    return mitsuba


def rgb(value: tuple[float, float, float]) -> dict[str, Any]:
    return {"type": "rgb", "value": list(value)}


def directions() -> tuple[np.ndarray, np.ndarray]:
    """Pairs all around; half of them near the mirror direction or near straight on, where narrow lobes are."""
    w_from, w_to = random_directions(400, 1), random_directions(400, 2)
    near = -w_from + 0.2 * random_directions(400, 3)
    near[::2, 2] *= -1
    near /= np.linalg.norm(near, axis=1, keepdims=True)
    w_to[200:] = near[200:]
    return w_from, w_to


def compare(mi: Any, b: Any, plugin: dict[str, Any], least: int) -> None:
    """All values and pdfs within 1e-3, with `least` pairs at least that scatter.

    The reflectance of nearly matched indices is rounded by more; it is small itself.
    """
    w_from, w_to = directions()
    value, pdf = mitsuba_values(mi, plugin, w_from, w_to)
    assert np.count_nonzero(pdf > 1e-6) >= least
    ours = evaluate(b, w_from, w_to)
    np.testing.assert_allclose(ours.all, value, rtol=1e-3, atol=2e-6)
    np.testing.assert_allclose(ours.pdf_all, pdf, rtol=1e-3, atol=2e-6)


def test_diffuse(mi: Any) -> None:
    plugin = {"type": "diffuse", "reflectance": rgb((0.2, 0.5, 0.9))}
    compare(mi, material(DIFFUSE, color=(0.2, 0.5, 0.9)), plugin, 60)


@pytest.mark.parametrize("alpha", ROUGHNESS)
@pytest.mark.parametrize("distribution", NAMES)
def test_rough_conductor(mi: Any, distribution: int, alpha: tuple[float, float]) -> None:
    plugin = {
        "type": "roughconductor",
        "distribution": NAMES[distribution],
        "alpha_u": alpha[0],
        "alpha_v": alpha[1],
        "eta": rgb(COPPER["eta"]),
        "k": rgb(COPPER["k"]),
        "specular_reflectance": rgb(REFLECTS),
    }
    b = material(CONDUCTOR, alpha=alpha, distribution=distribution, specular=REFLECTS, **COPPER)
    compare(mi, b, plugin, 40)


@pytest.mark.parametrize("eta", [1.5, 0.7, 3.0, 1.01])
@pytest.mark.parametrize("alpha", ROUGHNESS)
@pytest.mark.parametrize("distribution", NAMES)
def test_rough_dielectric(mi: Any, distribution: int, alpha: tuple[float, float], eta: float) -> None:
    plugin = {
        "type": "roughdielectric",
        "distribution": NAMES[distribution],
        "alpha_u": alpha[0],
        "alpha_v": alpha[1],
        "int_ior": eta,
        "ext_ior": 1.0,
        "specular_reflectance": rgb(REFLECTS),
        "specular_transmittance": rgb(TRANSMITS),
    }
    b = material(
        DIELECTRIC, eta=eta, alpha=alpha, distribution=distribution, specular=REFLECTS, transmittance=TRANSMITS
    )
    compare(mi, b, plugin, 80)


@pytest.mark.parametrize("distribution", NAMES)
def test_roughness_has_the_same_least_value(mi: Any, distribution: int) -> None:
    """Mitsuba clamps roughness to 1e-4 too. Half vectors are rounded there: values agree to some percent."""
    mirrored = {"type": "roughconductor", "distribution": NAMES[distribution], "alpha": 1e-5, "material": "none"}
    b = material(CONDUCTOR, eta=0.0, k=1.0, alpha=1e-5, distribution=distribution)
    w_from = np.stack([direction(theta) for theta in (0.0, 20.0, 40.0, 70.0)])
    w_to = w_from * np.array([-1, -1, 1], np.float32) + np.array([1e-4, 0, 0], np.float32)
    value, pdf = mitsuba_values(mi, mirrored, w_from, w_to)
    ours = evaluate(b, w_from, w_to)
    assert value.min() > 1e4
    np.testing.assert_allclose(ours.all, value, rtol=0.02)
    np.testing.assert_allclose(ours.pdf_all, pdf, rtol=0.02)


SMOOTH: dict[str, tuple[Any, dict[str, Any]]] = {
    "conductor": (
        material(CONDUCTOR, specular=REFLECTS, **COPPER),
        {
            "type": "conductor",
            "eta": rgb(COPPER["eta"]),
            "k": rgb(COPPER["k"]),
            "specular_reflectance": rgb(REFLECTS),
        },
    ),
    "mirror": (material(CONDUCTOR, eta=0.0, k=1.0), {"type": "conductor", "material": "none"}),
    **{
        f"{plugin} {eta}": (
            material(kind, eta=eta, specular=REFLECTS, transmittance=TRANSMITS),
            {
                "type": plugin,
                "int_ior": eta,
                "ext_ior": 1.0,
                "specular_reflectance": rgb(REFLECTS),
                "specular_transmittance": rgb(TRANSMITS),
            },
        )
        for kind, plugin in ((DIELECTRIC, "dielectric"), (THIN_DIELECTRIC, "thindielectric"))
        for eta in (1.5, 0.6, 2.4)
    },
}


@pytest.mark.parametrize("name", SMOOTH)
def test_smooth_materials(mi: Any, name: str) -> None:
    """The same random number picks the same lobe, with the same direction and weight, up to rounding of the border."""
    b, plugin = SMOOTH[name]
    bsdf = mi.load_dict(plugin)
    context, si = mi.BSDFContext(), mi.SurfaceInteraction3f()
    si.sh_frame = mi.Frame3f([0, 0, 1])
    w_from = random_directions(400, 4)
    u_lobe = np.random.default_rng(5).random(400, np.float32)
    ours = sample(b, w_from, (0.5, 0.5), u_lobe)
    lobes = set()
    for i, w in enumerate(w_from.tolist()):
        si.wi = w
        found, weight = bsdf.sample(context, si, float(u_lobe[i]), [0.5, 0.5], True)
        if max(weight) == 0:
            assert not ours.weight[i].any()
            continue
        np.testing.assert_allclose(ours.to[i], list(found.wo), atol=2e-6)
        np.testing.assert_allclose(ours.weight[i], list(weight), rtol=1e-4)
        assert ours.flags[i, 0] == 1
        assert (found.sampled_type & int(mi.BSDFFlags.Delta | mi.BSDFFlags.Null)) != 0
        lobes.add(bool(ours.flags[i, 3]))
    assert lobes == ({False} if b.kind == CONDUCTOR else {False, True})
