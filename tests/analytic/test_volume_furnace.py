"""A thing full of mist that absorbs nothing, under a sky of 1: wherever light comes from, 1 is seen."""

from __future__ import annotations

import numpy as np
import pytest
from furnaces import rendered, view
from numpy.typing import NDArray

from wdpm.scenes.meshes.primitives import cube, sphere
from wdpm.scenes.model.bsdfs import Null
from wdpm.scenes.model.lights import Environment
from wdpm.scenes.model.scene import Material, Medium, Mesh, Scene

SIZE = 32


def mist(shape: str, sigma_t: float) -> Scene:
    """A sphere or a cube that fills most of the view. Photons of grey light that loses nothing are the least noisy."""
    data = sphere() if shape == "sphere" else cube()
    edge = 0.6 if shape == "cube" else 1.0
    mesh = Mesh("mist", data.vertices * edge, data.faces, None, None, 0, interior=0, bounds=True)
    medium = Medium("mist", (sigma_t,) * 3, (1.0, 1.0, 1.0))
    camera = view((2.0, 1.5, 4.0), (0, 0, 0), 26, SIZE, up=(0, 1, 0))
    sky = Environment("sky", np.ones((1, 1, 3), np.float32))
    return Scene("mist", (mesh,), (Material("nothing", Null()),), (sky,), camera, media=(medium,))


def seen(what: Scene) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """The image, and where it shows the thing."""
    image = rendered(what, spp=4, photons=0, volume_photons=150_000, max_depth=100, all_effects=True)
    return image.pixels.astype(np.float64).mean(axis=2), image.layers["volume"].mean(axis=2) > 0


@pytest.mark.parametrize("shape", ["sphere", "cube"])
@pytest.mark.parametrize(("sigma_t", "tolerance"), [(0.7, 0.01), (3.0, 0.03), (12.0, 0.06)])
def test_mist_cannot_be_told_from_the_sky(shape: str, sigma_t: float, tolerance: float) -> None:
    """While discs that reach out of it counted whole, it was 2, 5 and 16 % darker, and 4, 13 and 24 % at
    a sphere's rim.

    What is left is of light that fades within a radius of the surface, where it is averaged over what is inside.
    """
    image, inside = seen(mist(shape, sigma_t))
    assert 0.25 < inside.mean() < 0.9
    assert image[inside].mean() == pytest.approx(1.0, abs=tolerance)
    assert image[~inside].mean() == pytest.approx(1.0, abs=1e-3)
    padded = np.pad(inside, 1)
    rim = inside & ~(padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:])
    assert image[rim].mean() == pytest.approx(1.0, abs=tolerance)
