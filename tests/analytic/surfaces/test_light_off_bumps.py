"""Light that grazes bumps, and what they throw on the walls about them: by photons as by path tracing.

The lamp hangs beside the wall. Half of its bumps face away from it, and paths find them dark.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnaces import quad, scene, view
from path_traced import assert_alike, over_seeds

from wdpm.cluster.render_settings import Indirect, Integrator
from wdpm.scenes.model.bsdfs import Bsdf, BumpMap, Diffuse, NormalMap, Plastic, TwoSided
from wdpm.scenes.model.scene import Material, Scene
from wdpm.scenes.model.textures import Bitmap

PHOTONS = {"all_effects": True, "photons": 60_000, "caustic_photons": 20_000, "indirect": Indirect.MAP, "spp": 16}
PATHS = {"all_effects": True, "integrator": Integrator.PATH, "spp": 512}

UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)


def leaning(most: float) -> Bitmap:
    """Normals that lean by angles up to one whose tangent is `most`."""
    normal = np.ones((8, 8, 3))
    normal[..., :2] = np.random.default_rng(1).uniform(-most, most, (8, 8, 2))
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    return Bitmap("normals", ((normal + 1.0) / 2.0).astype(np.float32))


def grazed_wall(bumps: Bsdf) -> Scene:
    """A box whose back wall a lamp grazes, seen from there: no bump is in the picture."""
    walls = [
        quad((-1, -1, -1), (0, 0, 2), (2, 0, 0)),
        quad((-1, 1, -1), (2, 0, 0), (0, 0, 2)),
        quad((-1, -1, -1), (0, 2, 0), (0, 0, 2)),
        quad((1, -1, -1), (0, 0, 2), (0, 2, 0)),
        quad((-1, -1, -1), (2, 0, 0), (0, 2, 0)),
        replace(quad((-1, -1, 1), (0, 2, 0), (2, 0, 0), 1), uvs=4.0 * UV),
        quad((-0.8, 0.98, 0.8), (1.6, 0, 0), (0, 0, 0.1), 2, (20.0, 20.0, 20.0)),
    ]
    what = scene(walls, view((0, 0, 0.9), (0, 0, -1), 90), (0.6, 0.6, 0.6))
    dark = Material("lamp", TwoSided(Diffuse((0.0, 0.0, 0.0))))
    return replace(what, materials=(what.materials[0], Material("bumps", TwoSided(bumps)), dark), max_depth=3)


@pytest.mark.parametrize(
    ("bumps", "layers"),
    [
        (NormalMap(Diffuse((0.7, 0.7, 0.7)), leaning(0.6)), "indirect"),
        (BumpMap(Diffuse((0.7, 0.7, 0.7)), leaning(0.6), 0.5), "indirect"),
        (NormalMap(Plastic(diffuse_reflectance=(0.6, 0.6, 0.6), alpha=0.2), leaning(0.6)), "indirect caustic"),
    ],
    ids=["normal map", "bump map", "coat"],
)
def test_what_bumps_throw_on_walls_is_what_paths_find(bumps: Bsdf, layers: str) -> None:
    paths = over_seeds(grazed_wall(bumps), "indirect", **PATHS)
    assert_alike(paths, over_seeds(grazed_wall(bumps), layers, **PHOTONS), share=0.02)
