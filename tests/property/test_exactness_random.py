"""The exactness contract on random scenes that are cut anyhow: by maps, final gathering, irradiance cache and paths."""

from __future__ import annotations

import random
from dataclasses import dataclass, replace

import numpy as np
import pytest
from digests import alone, same_bits
from given_tree import give_tree
from hypothesis import given, settings
from hypothesis import strategies as st
from random_scenes import scenes, scenes_with_effects

from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings, Routing
from wdpm.rendering.in_process import render_in_process
from wdpm.report.report import EnergyLedger
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.scene import Scene

pytestmark = pytest.mark.usefixtures("small_pilot")

MAP = RenderSettings(
    photons=300, caustic_photons=200, volume_photons=200, k=8, caustic_k=5, spp=2, indirect=Indirect.MAP
)
GATHER = replace(MAP, indirect=Indirect.GATHER, all_effects=True)


@dataclass(frozen=True)
class Way:
    """How light is found, in which scenes, and in how many of them."""

    settings: RenderSettings
    scenes: st.SearchStrategy[Scene]
    examples: int


WAYS = {
    "plain scenes": Way(MAP, scenes(), 24),
    "map": Way(replace(MAP, all_effects=True), scenes_with_effects(), 14),
    "gather": Way(GATHER, scenes() | scenes_with_effects(), 7),
    "cache": Way(replace(GATHER, indirect=Indirect.CACHE), scenes() | scenes_with_effects(), 7),
    "paths": Way(RenderSettings(integrator=Integrator.PATH, spp=3, all_effects=True), scenes_with_effects(), 10),
}
"""With kernels that many share, or each scene would have others to be compiled; own ones: test_exactness_effects.py."""


@pytest.mark.parametrize("way", WAYS)
def test_random_scenes_have_the_same_bits_in_any_partition(way: str) -> None:
    """Planes of cells go where the plan has them, or through vertices, lights and the camera."""

    @settings(max_examples=WAYS[way].examples, deadline=None, derandomize=True)
    @given(
        scene=WAYS[way].scenes,
        chosen=st.builds(
            lambda **changes: replace(WAYS[way].settings, **changes),
            seed=st.integers(0, 2**32 - 1),
            max_depth=st.sampled_from([None, None, None, 2, 4]),
            light_samples=st.sampled_from([1, 2]),
            bucket=st.sampled_from([5, 8, 32]),
        ),
        cells=st.sampled_from([2, 4, 8]),
        workers=st.sampled_from([1, 2, 3, 5]),
        data=st.data(),
    )
    def the_bits_are_the_same(
        scene: Scene, chosen: RenderSettings, cells: int, workers: int, data: st.DataObject
    ) -> None:
        expected = alone(scene, chosen)
        with pytest.MonkeyPatch.context() as patch:
            if data.draw(st.booleans(), label="planes through what is there"):
                give_planes_through_places(patch, scene, cells, data)
            images = [
                render_in_process(
                    scene,
                    replace(chosen, routing=routing),
                    workers=min(workers, cells),
                    cells=cells,
                    threads=2,
                    shuffle=random.Random(chosen.seed),
                )
                for routing in Routing
            ]
        for image in images:
            assert same_bits(image, expected)
            for of_map in ("photons", "caustics", "volume"):
                assert image.metadata["report"][of_map] == expected.metadata["report"][of_map]
        for image in (expected, *images):
            assert image.metadata["report"]["nonfinite"] == {}
            assert EnergyLedger(**image.metadata["report"]["energy"]).imbalance < 1e-5

    the_bits_are_the_same()


def give_planes_through_places(patch: pytest.MonkeyPatch, scene: Scene, cells: int, data: st.DataObject) -> None:
    """Each through a vertex, a light or the camera: of lattice scenes that is through faces and edges."""
    flat = flatten(scene)
    lights = flat.lights.delta_position[: flat.lights.near]
    places = np.concatenate([flat.triangles.positions.reshape(-1, 3), lights, flat.camera.to_world[None, :3, 3]])
    axis = [data.draw(st.integers(0, 2)) for _ in range(cells - 1)]
    give_tree(patch, axis, [float(places[data.draw(st.integers(0, len(places) - 1)), a]) for a in axis])
