"""Materials against Mitsuba 3 itself: its own parameters of what both read from the same text."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mitsuba_xml import number

from wdpm.scenes import load
from wdpm.scenes.mitsuba.metals import METALS
from wdpm.scenes.mitsuba.refraction_indices import INDICES

LAMP = '<shape type="rectangle"><emitter type="area"/></shape>'
DIFFUSE = '<bsdf type="diffuse"/>'
ANISOTROPIC = '<float name="alpha_u" value="0.2"/><float name="alpha_v" value="0.3"/>'


def plugin(kind: str, inside: str = "") -> str:
    return f'<bsdf type="{kind}">{inside}</bsdf>'


def word(name: str, value: str) -> str:
    return f'<string name="{name}" value="{value}"/>'


def traversed(text: str) -> dict[str, np.ndarray]:
    """The parameters of a bsdf as Mitsuba 3 reads it."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    level = mi.logger().log_level()
    mi.set_log_level(mi.LogLevel.Error)  # some named materials are out of gamut, which Mitsuba warns of
    try:
        parameters = mi.traverse(mi.load_string(text.replace("<bsdf", '<bsdf version="3.0.0"', 1)))
    finally:
        mi.set_log_level(level)
    return {key: np.array(parameters[key], dtype=np.float64) for key in parameters.keys()}  # noqa: SIM118


@pytest.mark.parametrize("name", METALS)
def test_metals_are_mitsubas(name: str) -> None:
    theirs = traversed(plugin("conductor", word("material", name)))
    for ours, key in zip(METALS[name], ("eta.value", "k.value"), strict=True):
        np.testing.assert_allclose(np.broadcast_to(theirs[key], 3), ours, rtol=2e-5, atol=1e-12)


def test_indices_are_mitsubas() -> None:
    for name, ours in INDICES.items():
        theirs = traversed(plugin("dielectric", word("int_ior", name) + word("ext_ior", "vacuum")))["eta"]
        assert float(theirs) == pytest.approx(ours, rel=1e-6)


PARAMETERS = [
    (plugin("roughplastic", number("alpha", 0.2) + word("int_ior", "water")), {"alpha": "alpha", "eta": "eta"}),
    (plugin("plastic"), {"eta": "eta", "diffuse_reflectance": "diffuse_reflectance.value"}),
    (plugin("roughdielectric", ANISOTROPIC), {"alpha_u": "alpha_u.value", "alpha_v": "alpha_v.value", "eta": "eta"}),
    (plugin("roughconductor"), {"alpha_u": "alpha.value", "eta": "eta.value", "k": "k.value"}),
    (plugin("thindielectric", number("ext_ior", 1.2)), {"eta": "eta"}),
    (plugin("principled", number("eta", 1.33)), {"eta": "eta", "roughness": "roughness.value"}),
    (plugin("blendbsdf", number("weight", 0.3) + DIFFUSE * 2), {"weight": "weight.value"}),
    (plugin("mask", DIFFUSE), {"opacity": "opacity.value"}),
]


@pytest.mark.parametrize(("text", "names"), PARAMETERS)
def test_parameters_are_mitsubas(tmp_path: Path, text: str, names: dict[str, str]) -> None:
    theirs = traversed(text)
    file = tmp_path / "scene.xml"
    file.write_text(f'<scene version="3.0.0"><shape type="rectangle">{text}</shape>{LAMP}</scene>')
    ours = load(file).materials[0].bsdf
    for name, key in names.items():
        values = np.broadcast_to(theirs[key], np.shape(getattr(ours, name)))
        np.testing.assert_allclose(getattr(ours, name), values, rtol=1e-6)
