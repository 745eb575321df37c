"""What the camera sees through the boundary of another medium has no records: their gather rays set out in its own."""

from __future__ import annotations

from dataclasses import replace

from furnaces import box, quad, scene, view
from path_traced import assert_alike, over_seeds

from wdpm.cluster.render_settings import Indirect, Integrator
from wdpm.scenes.model.bsdfs import Diffuse, Null
from wdpm.scenes.model.scene import Material, Medium, Scene

PATHS = {"all_effects": True, "integrator": Integrator.PATH, "spp": 256}
CACHE = {"all_effects": True, "indirect": Indirect.CACHE, "spp": 16}
PHOTONS = {"photons": 60_000, "caustic_photons": 1_000, "volume_photons": 60_000}


def smoky_case() -> Scene:
    """A room with a case of smoke about a block, whose boundary nothing is seen of."""
    walls = [
        box((1, 1, 1), inside=True),
        quad((-0.3, 0.98, -0.3), (0.6, 0, 0), (0, 0, 0.6), 1, (9.0, 9.0, 9.0)),
        replace(box((0.5, 0.5, 0.5), (0, -0.49, 0.3)), material=2, interior=0, bounds=True),
        replace(box((0.25, 0.25, 0.25), (0, -0.7, 0.3)), material=3),
    ]
    what = scene(walls, view((0.2, 0.1, -0.95), (0, -0.5, 0.3), 50), (0.6, 0.6, 0.6))
    more = (
        Material("lamp", Diffuse((0.0, 0.0, 0.0))),
        Material("case", Null()),
        Material("block", Diffuse((0.8, 0.8, 0.8))),
    )
    smoke = Medium("smoke", (3.0, 3.0, 3.0), (0.5, 0.5, 0.5))
    return replace(what, materials=(*what.materials, *more), media=(smoke,))


def test_a_block_in_smoke_is_what_paths_find() -> None:
    what = smoky_case()
    assert_alike(over_seeds(what, "beauty", **PATHS), over_seeds(what, "beauty", **CACHE, **PHOTONS), 0.015)
