"""Light through sheets that scatter it to their other side: curtains, shades. By photons as by path tracing.

Photons lie where they arrive, on the lit side; what is seen of a sheet is the light behind it, be it of lamps, of other
walls, or of another sheet.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnace_cases import SKY
from furnaces import box, quad, rendered, scene, view
from path_traced import assert_alike, over_seeds

from wdpm.cluster.render_settings import Indirect, Integrator
from wdpm.scenes.meshes.primitives import cube, sphere
from wdpm.scenes.model.bsdfs import WHITE, Blend, Bsdf, Conductor, Diffuse, Mask, NormalMap, Null, Translucent, TwoSided
from wdpm.scenes.model.scene import Material, Medium, Mesh, Scene
from wdpm.scenes.model.textures import Bitmap

PHOTONS = {"all_effects": True, "photons": 60_000, "caustic_photons": 10_000, "spp": 16}
PATHS = {"all_effects": True, "integrator": Integrator.PATH, "spp": 256}

CLOTH = (0.5, 0.7, 0.3)
GREY = Diffuse((0.4, 0.4, 0.4))


def bumps() -> Bitmap:
    """Normals that lean by up to 30 degrees."""
    normal = np.ones((8, 8, 3))
    normal[..., :2] = np.random.default_rng(1).uniform(-0.4, 0.4, (8, 8, 2))
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    return Bitmap("normals", ((normal + 1.0) / 2.0).astype(np.float32))


SHEETS: dict[str, Bsdf] = {
    "sheet": Translucent(CLOTH),
    "paper": Blend(TwoSided(GREY), Translucent(CLOTH), 0.6),
    "lining": Blend(TwoSided(GREY, Conductor()), Translucent(CLOTH), 0.6),
    "lace": Mask(Translucent(CLOTH), 0.7),
    "woven": NormalMap(Blend(TwoSided(GREY), Translucent(CLOTH), 0.6), bumps()),
}


def curtained(sheet: Bsdf) -> Scene:
    """A box, a lamp in its far third, and a sheet before that, which leaves a gap above the floor."""
    uv = np.array([[0, 0], [3, 0], [3, 3], [0, 3]], np.float32)
    walls = [
        box((1, 1, 1), inside=True),
        replace(quad((-1, -0.9, 0.3), (2, 0, 0), (0, 1.9, 0), 1), uvs=uv),
        quad((-0.4, -0.3, 0.98), (0, 0.6, 0), (0.8, 0, 0), 2, (9.0, 9.0, 9.0)),
    ]
    what = scene(walls, view((0.2, 0.1, -0.95), (0, -0.1, 1), 80), (0.6, 0.6, 0.6))
    return replace(
        what,
        materials=(what.materials[0], Material("sheet", sheet), Material("lamp", Diffuse((0.0, 0.0, 0.0)))),
    )


@pytest.mark.parametrize("indirect", list(Indirect))
@pytest.mark.parametrize("name", list(SHEETS))
def test_a_curtained_room_is_what_paths_find(name: str, indirect: Indirect) -> None:
    what = curtained(SHEETS[name])
    assert_alike(over_seeds(what, "beauty", **PATHS), over_seeds(what, "beauty", indirect=indirect, **PHOTONS), 0.02)


@pytest.mark.parametrize("indirect", list(Indirect))
@pytest.mark.parametrize("shape", ["cube", "ball"])
def test_what_lets_all_light_through_is_not_seen(shape: str, indirect: Indirect) -> None:
    """In it there is a sky of radiance 1, all of it seen through the thing.

    Gather rays find it by shadow rays alone, half of which set out for what lies below: so records must not be made
    brighter by how further rays are shared out.
    """
    data = cube() if shape == "cube" else sphere(64)
    thing = Mesh("thing", data.vertices, data.faces, data.normals, data.uvs, 0)
    camera = view((0.3, 0.4, -4.0), (0, 0, 0), 20, 12)
    furnace = Scene("furnace", (thing,), (Material("thing", Translucent(WHITE)),), (SKY,), camera, max_depth=40)
    image = rendered(furnace, indirect=indirect, photons=200_000, spp=256, all_effects=True)
    assert image.pixels.mean() == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("indirect", [Indirect.MAP, Indirect.CACHE])
def test_fog_in_a_paper_ball_is_what_paths_find(indirect: Indirect) -> None:
    """Light that comes through is in the medium on the other side, shadow rays and photons as well."""
    what = curtained(Null())
    ball = sphere(24)
    paper = Mesh("ball", 0.5 * ball.vertices, ball.faces, ball.normals, ball.uvs, 3, interior=0, bounds=True)
    fog = Medium("fog", (2.0, 2.0, 2.0), (0.8, 0.8, 0.8))
    materials = (*what.materials, Material("paper", Blend(TwoSided(GREY), Translucent(CLOTH), 0.7)))
    what = replace(what, meshes=(*what.meshes, paper), materials=materials, media=(fog,))
    chosen = {**PHOTONS, "volume_photons": 60_000, "indirect": indirect}
    assert_alike(over_seeds(what, "beauty", **PATHS), over_seeds(what, "beauty", **chosen), 0.02)
