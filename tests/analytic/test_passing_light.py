"""Light that passes: depth limits through glass, lamps behind panes and masks, shadows of both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnaces import Array, box, quad, rendered, scene, view
from reflectance import fresnel

from wdpm.scenes.model.bsdfs import Bsdf, Dielectric, Diffuse, Mask, Null, ThinDielectric, TwoSided
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Material, Mesh, Scene

RADIANCE = (4.0, 2.0, 1.0)
LAMP = quad((-1, -1, 1), (0, 2, 0), (2, 0, 0), 0, RADIANCE)  # faces -z
BEFORE = quad((-0.5, -0.5, 0), (0, 1, 0), (1, 0, 0))
AHEAD = view((0, 0, -1), (0, 0, 1), 1, 8, up=(0, 1, 0))


def behind(thing: Mesh, bsdf: Bsdf) -> Scene:
    """A black lamp behind a thing, seen at right angles."""
    what = scene([LAMP, replace(thing, material=1)], AHEAD, (0, 0, 0))
    return replace(what, materials=(*what.materials, Material("thing", bsdf)))


def share_seen(what: Scene, max_depth: int | None, spp: int = 1024) -> float:
    """Radiance as a share of the lamp's."""
    image = rendered(what, photons=0, caustic_photons=0, spp=spp, max_depth=max_depth, all_effects=True)
    seen = image.pixels.astype(np.float64).mean(axis=(0, 1)) / RADIANCE
    np.testing.assert_allclose(seen, seen[0], rtol=1e-5, atol=1e-9)
    return float(seen[0])


R = 0.25  # of an interface of eta 3 at right angles


@pytest.mark.parametrize(
    ("max_depth", "share"),
    [
        (1, 0.0),
        (2, 0.0),
        (3, (1 - R) ** 2),  # camera - glass - glass - lamp
        (4, (1 - R) ** 2),
        (5, (1 - R) ** 2 * (1 + R**2)),  # and once to and fro in the glass
        (6, (1 - R) ** 2 * (1 + R**2)),
        (None, (1 - R) / (1 + R)),
    ],
)
def test_each_side_of_glass_is_an_edge_of_the_path(max_depth: int | None, share: float) -> None:
    slab = box((0.5, 0.5, 0.1))
    # 64 pixels of 1024 samples, each the lamp or nothing: 0.5 / 256 = 0.2 % if independent.
    assert share_seen(behind(slab, Dielectric(3.0)), max_depth) == pytest.approx(share, abs=4e-3)


@pytest.mark.parametrize(
    ("bsdf", "share"),
    [
        (ThinDielectric(3.0), (1 - R) / (1 + R)),
        (ThinDielectric(3.0, specular_transmittance=(0.5, 0.5, 0.5)), 0.5 * (1 - R) / (1 + R)),
        (Mask(TwoSided(Diffuse((0.0, 0.0, 0.0))), 0.3), 0.7),
        (Null(), 1.0),
    ],
    ids=["pane", "tinted pane", "mask", "nothing"],
)
@pytest.mark.parametrize("max_depth", [1, None])
def test_straight_passages_are_no_edges(bsdf: Bsdf, share: float, max_depth: int | None) -> None:
    assert share_seen(behind(BEFORE, bsdf), max_depth) == pytest.approx(share, abs=4e-3)


def lit_through(bsdf: Bsdf | None, angle: float) -> Array:
    """Direct light of a floor whose point light is seen at an angle, with or without a pane half way."""
    a = np.radians(angle)
    floor = quad((-5, 0, -5), (0, 0, 10), (10, 0, 0))
    point = PointLight("p", (float(np.sin(a)), float(np.cos(a)), 0.0), RADIANCE)
    pane = replace(quad((-3, 0.5 * np.cos(a), -3), (0, 0, 6), (6, 0, 0)), material=1)
    what = scene(
        [floor] if bsdf is None else [floor, pane], view((0, 0.1, -0.2), (0, 0, 0), 0.001), (0.8,) * 3, (point,)
    )
    what = replace(what, materials=(*what.materials, Material("pane", bsdf or Null())))
    image = rendered(what, photons=0, caustic_photons=0, spp=1, all_effects=True)
    return np.asarray(image.layers["direct"].mean(axis=(0, 1), dtype=np.float64))


@pytest.mark.parametrize("angle", [0.0, 40.0, 75.0])
def test_a_lamp_shines_straight_through(angle: float) -> None:
    """No sampling: shadow rays take the mean of what passes."""
    free = lit_through(None, angle)
    once = float(fresnel(np.float64(np.cos(np.radians(angle))), 1.5))
    passes = (1 - once) / (1 + once)
    for bsdf, share in (
        (ThinDielectric(1.5), passes),
        (ThinDielectric(1.5, (1.0, 1.0, 1.0), (0.5, 0.5, 0.5)), 0.5 * passes),
        (Mask(Diffuse(), 0.3), 0.7),
        (Null(), 1.0),
        (Dielectric(1.5), 0.0),
        (Diffuse(), 0.0),
    ):
        np.testing.assert_allclose(lit_through(bsdf, angle), free * share, rtol=1e-4)


def test_photons_pass_panes_as_shadow_rays_do() -> None:
    """A lamp behind a pane in a closed room: the ledger closes, and indirect light is dimmer by what the pane keeps."""
    point = PointLight("p", (0.0, 0.5, 0.0), RADIANCE)
    tray = replace(quad((-0.99, 0.0, -0.99), (0, 0, 1.98), (1.98, 0, 0)), material=1)
    room = scene([box((1, 1, 1), inside=True), tray], view((0, -0.2, -0.9), (0, -1, 0), 60, 8), (0.5,) * 3, (point,))
    seen = []
    for bsdf in (Null(), Mask(Diffuse((0.0, 0.0, 0.0)), 0.5)):
        what = replace(room, materials=(*room.materials, Material("tray", bsdf)))
        image = rendered(what, photons=50_000, spp=4, max_depth=3, all_effects=True)
        seen.append(image.layers["direct"].mean(dtype=np.float64))
    assert seen[1] / seen[0] == pytest.approx(0.5, rel=1e-3)
