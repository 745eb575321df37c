"""Shadow rays that are picked from several ways to lights: the light of all, with the noise of several shadow rays."""

from __future__ import annotations

import numpy as np
from furnace_cases import SKY
from furnaces import quad, rendered, view
from path_traced import PATH, assert_alike, over_seeds

from wdpm.scenes.model.bsdfs import Conductor
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Material, Scene, diffuse

FLOOR = quad((-4, 0, -4), (0, 0, 8), (8, 0, 0))
CAMERA = view((0, 1.5, -2.5), (0, 0, 0), 30, size=16)
LAMPS = tuple(
    PointLight("lamp", (1.5 * np.sin(angle), 1.0, 1.5 * np.cos(angle)), (1.0, 0.8, 0.6))
    for angle in np.linspace(0, 2 * np.pi, 7)[:-1]
)
METAL = Material("metal", Conductor(alpha_u=0.2, alpha_v=0.2))


def floor(material: Material, lights: tuple[object, ...]) -> Scene:
    return Scene("floor", (FLOOR,), (material,), lights, CAMERA)  # type: ignore[arg-type]


def test_lamps_light_a_metal_by_as_much_as_each_alone() -> None:
    """With one lamp there is one way, and no noise but that of the places in a pixel."""
    alone = [over_seeds(floor(METAL, (lamp,)), "direct", spp=64, max_depth=2, **PATH) for lamp in LAMPS]
    exact = np.sum([mean for mean, _ in alone], axis=0), np.linalg.norm([off for _, off in alone], axis=0)
    found = over_seeds(floor(METAL, LAMPS), "direct", spp=64, max_depth=2, **PATH)
    assert (found[1] < 0.02 * found[0]).all()
    assert_alike(found, exact)


def test_one_picked_shadow_ray_is_nearly_as_good_as_four() -> None:
    """Where nothing is in the way: four have one way each, as many as one is picked from."""

    def variance(light_samples: int) -> float:
        chosen = {"spp": 1, "max_depth": 2, "light_samples": light_samples, **PATH}
        what = floor(METAL, LAMPS)
        pixels = [rendered(what, seed=seed, **chosen).layers["direct"].mean(axis=2) for seed in range(24)]
        return float(np.var(pixels, axis=0, ddof=1).mean())

    assert variance(1) < 1.5 * variance(4)


def test_a_sky_and_a_lamp_light_a_floor_by_as_much_as_where_nothing_is_picked() -> None:
    """With photons a shadow ray of a diffuse surface is picked from two ways, by path tracing it is not."""
    what = floor(diffuse("grey", (0.5, 0.4, 0.3)), (SKY, LAMPS[0]))
    chosen = {"all_effects": True, "spp": 16, "max_depth": 2, "photons": 1000}
    assert_alike(over_seeds(what, "direct", **chosen), over_seeds(what, "direct", spp=64, max_depth=2, **PATH))
