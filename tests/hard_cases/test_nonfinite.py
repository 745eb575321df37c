"""What is not finite is caught where it arises, counted by cause, and leaves the image finite."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import wdpm
from wdpm.cluster.integrators.indirect import Indirect
from wdpm.cluster.integrators.registry import Integrator
from wdpm.scenes import cornell_box
from wdpm.scenes.errors import SceneError
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Camera, Mesh, diffuse

FEW = wdpm.RenderSettings(photons=1000, spp=2)


def square(height: float, facing: int) -> Mesh:
    """A unit square at y = height that faces up (1) or down (-1)."""
    corners = np.array([[-0.5, height, -0.5], [-0.5, height, 0.5], [0.5, height, 0.5], [0.5, height, -0.5]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])[:, ::facing]
    return Mesh(f"square at {height}", corners, faces, None, None, 0)


def test_an_overflow_is_counted_and_black() -> None:
    """A lamp near the largest float right above a floor: the floor's light overflows, and the image must not."""
    star = PointLight("star", (0.0, 0.1, 0.0), (5e37, 5e37, 5e37))
    to_world = np.diag([-1.0, 1.0, -1.0, 1.0])  # looks along -z
    to_world[:3, 3] = (0.0, 0.05, 1.0)
    camera = Camera(to_world, fov_x=40.0, width=12, height=12)
    scene = wdpm.Scene(
        "too bright",
        (square(0.0, 1),),
        (diffuse("white", (0.9, 0.9, 0.9), twosided=True),),
        (star,),
        camera,
    )
    image = wdpm.render(scene, replace(FEW, integrator=Integrator.PATH), threads=1)
    report = image.metadata["report"]
    assert image.layers["depth"].max() > 0.5
    assert report["nonfinite"]["direct"] > 0
    assert all(np.isfinite(layer).all() for layer in image.layers.values())


def box_lit_by(radiance: float) -> wdpm.Scene:
    scene = cornell_box((12, 12))
    meshes = (replace(mesh, emission=(radiance,) * 3) if mesh.emission else mesh for mesh in scene.meshes)
    return replace(scene, meshes=tuple(meshes))


@pytest.mark.parametrize("indirect", Indirect)
@pytest.mark.parametrize("integrator", [Integrator.PHOTONS, Integrator.AUTO])
def test_a_lamp_whose_photons_would_overflow_is_named(integrator: Integrator, indirect: Indirect) -> None:
    """No float holds what its photons carry, or what is gathered of them. Photons were asked for in both cases."""
    chosen = replace(FEW, integrator=integrator, indirect=indirect)
    with pytest.raises(SceneError, match=r'lamp "lamp" shines with 1\.3e\+43 W, and photons .*; dim all lamps alike'):
        wdpm.render(box_lit_by(3e38), chosen, threads=1)


def test_a_lamp_too_bright_for_photons_is_rendered_by_paths() -> None:
    image = wdpm.render(box_lit_by(1e35), spp=2, threads=1)
    (why,) = (line for line in image.metadata["report"]["chose"] if line.startswith("integrator: "))
    assert why.startswith('integrator: path, since lamp "lamp" shines with 4.3e+39 W')
    dim = wdpm.render(box_lit_by(1.0), spp=2, integrator="path", threads=1)
    assert np.allclose(image.layers["beauty"], dim.layers["beauty"] * np.float32(1e35), rtol=1e-4)


@pytest.mark.parametrize("indirect", [Indirect.MAP, Indirect.GATHER, Indirect.CACHE])
def test_the_brightest_lamps_that_photons_carry(indirect: Indirect) -> None:
    """Nothing overflows, and nothing but the unit of light changes."""
    chosen = replace(FEW, integrator=Integrator.PHOTONS, indirect=indirect)
    bright, dim = (wdpm.render(box_lit_by(radiance), chosen, threads=1) for radiance in (2.0**106, 2.0**10))
    assert bright.metadata["report"]["guards"] == {}
    for name in ("direct", "indirect"):
        assert np.allclose(bright.layers[name], dim.layers[name] * np.float32(2.0**96), rtol=1e-5), name


def test_a_lamp_beyond_single_precision_in_the_units_of_the_renderer_is_named() -> None:
    """Its intensity is a float; divided by the square of half the scene's side it is none."""
    star = PointLight("star", (0.0, 0.1, 0.0), (0.0, 3e38, 0.0))
    white = diffuse("white", (0.9, 0.9, 0.9), twosided=True)
    camera = Camera(np.eye(4), fov_x=40.0, width=2, height=2)
    scene = wdpm.Scene("beyond", (square(0.0, 1),), (white,), (star,), camera)
    with pytest.raises(SceneError, match=r'light "star" is brighter than single precision .*; dim all lamps alike'):
        wdpm.render(scene, spp=1, threads=1)


def test_a_sound_scene_counts_nothing() -> None:
    image = wdpm.render(cornell_box((12, 12)), FEW, threads=1)
    assert image.metadata["report"]["nonfinite"] == {}
