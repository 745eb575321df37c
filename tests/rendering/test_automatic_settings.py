"""What is said of settings that nobody chose."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from tests.helpers.effect_scenes import fogs
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.kernels.compile import compile_kernels
from wdpm.kernels.launch import Launcher
from wdpm.rendering.automatic_settings import choose_settings
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.bsdfs import Conductor
from wdpm.scenes.model.scene import Material, Scene


def said_of(scene: Scene, **chosen: Any) -> tuple[str, ...]:
    settings = RenderSettings(**{"integrator": Integrator.AUTO, "spp": 2, "all_effects": True} | chosen)
    return choose_settings(
        flatten(scene), settings, Launcher("cpu", 1), lambda features: compile_kernels("cpu", features)
    ).chose


def test_maps_that_nobody_spoke_of_are_said_to_have_photons_as_ever() -> None:
    """Whoever asks for few, for a quick look, has 250,000 in the caustic map, and wonders what takes so long."""
    dull = cornell_box((16, 12))
    metal = Material("metal", Conductor())
    shiny = replace(dull, materials=(dull.materials[0], *[metal] * (len(dull.materials) - 1)))
    said = "caustic photons: 250,000, as ever: --photons is of the global map alone; "
    assert any(line.startswith(said) for line in said_of(shiny, photons=2000))
    for scene, chosen in (
        (shiny, {}),
        (shiny, {"photons": 2000, "caustic_photons": 1000}),
        (shiny, {"photons": 2000, "integrator": Integrator.PATH}),
        (dull, {"photons": 2000}),
    ):
        assert not any("as ever" in line for line in said_of(scene, **chosen))
    assert any(line.startswith("volume photons: 250,000") for line in said_of(fogs(), photons=2000))
