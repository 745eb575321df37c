"""Light in media: energy in a closed room, and single scattering against quadrature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fog import foggy, single_scattering
from furnaces import box, quad, rendered, scene, view

from wdpm.cluster.render_settings import RenderSettings
from wdpm.rendering.in_process import render_in_process
from wdpm.report.report import EnergyLedger
from wdpm.scenes.model.bsdfs import Null
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Material, Medium, Scene


def ledger(what: Scene, **chosen: object) -> EnergyLedger:
    """Where the power of photons went."""
    settings = RenderSettings(photons=60_000, volume_photons=60_000, spp=1, all_effects=True, **chosen)  # type: ignore[arg-type]
    energy = EnergyLedger(**render_in_process(what, settings, workers=1).metadata["report"]["energy"])
    assert energy.imbalance < 1e-5
    return energy


@pytest.mark.parametrize(
    ("sigma_t", "max_depth", "tolerance"),
    [((3.0, 3.0, 3.0), 8, 1e-4), ((0.5, 3.0, 9.0), 4, 0.03)],
    ids=["grey", "coloured"],
)
def test_a_medium_that_absorbs_nothing_keeps_all_energy(
    sigma_t: tuple[float, float, float], max_depth: int, tolerance: float
) -> None:
    """All that was emitted is still under way at the depth limit.

    Grey: every weight is 1. Coloured: a weight is between 0 and 3 and 1 in the mean, so that what is "absorbed", which
    may be negative at a collision, sums to nothing but noise: a deviation of some 1 % in 60,000 paths (measured).
    """
    energy = ledger(foggy(Medium("milk", sigma_t, (1.0, 1.0, 1.0), 0.5), 1.0), max_depth=max_depth)
    assert energy.escaped == 0.0
    assert energy.travelling == pytest.approx(energy.emitted, rel=tolerance)
    assert abs(energy.absorbed) < tolerance * energy.emitted


def test_a_medium_without_volume_photons_still_absorbs() -> None:
    what = foggy(Medium("haze", (1.0, 1.0, 1.0), (0.5, 0.5, 0.5), 0.0), 0.5)
    image = rendered(what, photons=2000, volume_photons=0, spp=1, all_effects=True)
    assert "volume" not in image.layers or image.layers["volume"].max() == 0


def test_no_photon_gets_through_a_wall_from_within_a_medium() -> None:
    """Nothing is absorbed in a white room full of white fog, not one photon of 60,000: their weights are 1."""
    energy = ledger(foggy(Medium("milk", (3.0, 3.0, 3.0), (1.0, 1.0, 1.0), 0.5), 1.0), max_depth=8)
    assert energy.escaped == 0.0
    assert abs(energy.absorbed) < 1e-6 * energy.emitted


def test_a_medium_absorbs_what_its_albedo_leaves() -> None:
    """A black room and a dense medium: nearly all light collides at once; 1 - albedo of each channel is absorbed."""
    albedo = (0.9, 0.5, 0.1)
    energy = ledger(foggy(Medium("ink", (200.0,) * 3, albedo), 0.0), max_depth=3)
    kept = float(np.dot(albedo, (3.0, 2.0, 1.0)) / 6.0)
    assert energy.travelling == pytest.approx(kept * energy.emitted, rel=0.01)


@pytest.mark.parametrize("g", [0.0, 0.6, -0.4])
def test_single_scattering_is_that_of_quadrature(g: float) -> None:
    what = foggy(Medium("haze", (0.2, 0.5, 1.0), (0.9, 0.8, 0.6), g), 0.0)
    image = rendered(what, photons=0, volume_photons=200_000, spp=4, max_depth=2, all_effects=True)
    volume = image.layers["volume"].astype(np.float64).mean(axis=(0, 1))
    exact = single_scattering(what)
    # The view holds a tenth of the room and so some 20,000 photons; their weights by channel are up to 3, and phase
    # functions up to 10 times each other: 1.2 % at most. Blur over a beam's radius keeps the sum but at rims: 0.5 %.
    np.testing.assert_allclose(volume, exact, rtol=0.04)


def test_surfaces_are_seen_and_lit_through_the_medium() -> None:
    """Direct light of a wall: the light's way to it and the way to the eye both attenuate."""
    medium = Medium("soot", (0.3, 0.6, 1.2), (0.0, 0.0, 0.0))
    what = foggy(medium, 0.8)
    looking = replace(view((0, 0, -0.5), (0, 0, 1), 0.01, 4, up=(0, 1, 0)), medium=0)
    seen = [
        rendered(replace(what, camera=camera, media=media, lights=lights), photons=0, spp=1, all_effects=True)
        .layers["direct"]
        .astype(np.float64)
        .mean(axis=(0, 1))
        for camera, media, lights in (
            (looking, what.media, what.lights),
            (replace(looking, medium=None), (), (replace(what.lights[0], medium=None),)),
        )
    ]
    near = looking.near_clip  # rays start there
    way = 1.5 - near + float(np.linalg.norm(np.array([0, 0, 1.0]) - (0.75, 0.1, 0.0)))
    np.testing.assert_allclose(seen[0] / seen[1], np.exp(-way * np.array(medium.sigma_t)), rtol=1e-4)


def test_a_box_of_smoke_attenuates_a_lamp_behind_it() -> None:
    """A boundary that is nothing: the lamp is seen, and lights a wall, through 0.4 of medium."""
    smoke = replace(box((0.3, 0.3, 0.2)), material=1, interior=0, bounds=True)
    lamp = quad((-0.3, -0.3, 0.6), (0, 0.6, 0), (0.6, 0, 0), 0, (5.0, 5.0, 5.0))  # faces -z
    medium = Medium("smoke", (1.0, 2.0, 3.0), (0.0, 0.0, 0.0))
    what = scene([lamp, smoke], view((0, 0, -1.0), (0, 0, 1), 2, 6, up=(0, 1, 0)), (0.5,) * 3)
    what = replace(what, materials=(*what.materials, Material("nothing", Null())), media=(medium,))
    seen = rendered(what, photons=0, spp=1, all_effects=True).pixels.astype(np.float64)
    # The middle of the view crosses 0.4 at right angles; 1 degree aside it is 1.5e-4 longer.
    np.testing.assert_allclose(seen.mean(axis=(0, 1)), 5.0 * np.exp(-0.4 * np.array(medium.sigma_t)), rtol=1e-3)

    floor = quad((-0.01, -0.01, -0.6), (0.02, 0, 0), (0, 0.02, 0))  # faces +z, towards the lamp
    point = PointLight("lamp", (0.0, 0.0, 0.6), (1.0, 1.0, 1.0))
    beside = view((0.5, 0, 0.0), (0, 0, -0.6), 0.5, 6, up=(0, 1, 0))
    lit = replace(what, meshes=(floor, smoke), lights=(point,), camera=beside)
    seen = rendered(lit, photons=0, spp=1, all_effects=True).layers["direct"].astype(np.float64)
    exact = 0.5 / np.pi / 1.2**2 * np.exp(-0.4 * np.array(medium.sigma_t))
    np.testing.assert_allclose(seen.mean(axis=(0, 1)), exact, rtol=1e-3)
