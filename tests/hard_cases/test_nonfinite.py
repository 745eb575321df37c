"""What is not finite is caught where it arises, counted by cause, and leaves the image finite."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import wdpm
from wdpm.scenes import cornell_box
from wdpm.scenes.model.scene import Camera, Mesh, diffuse

FEW = wdpm.RenderSettings(photons=1000, spp=2)


def square(height: float, facing: int, emission: tuple[float, float, float] | None = None) -> Mesh:
    """A unit square at y = height that faces up (1) or down (-1)."""
    corners = np.array([[-0.5, height, -0.5], [-0.5, height, 0.5], [0.5, height, 0.5], [0.5, height, -0.5]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])[:, ::facing]
    return Mesh(f"square at {height}", corners, faces, None, None, 0, emission)


def test_an_overflow_is_counted_and_black() -> None:
    """A lamp near the largest float right above a floor: the floor's light overflows, and the image must not."""
    to_world = np.diag([-1.0, 1.0, -1.0, 1.0])  # looks along -z
    to_world[:3, 3] = (0.0, 0.05, 1.0)
    camera = Camera(to_world, fov_x=40.0, width=12, height=12)
    scene = wdpm.Scene(
        "too bright",
        (square(0.0, 1), square(0.1, -1, (3e38, 3e38, 3e38))),
        (diffuse("white", (0.9, 0.9, 0.9), twosided=True),),
        (),
        camera,
    )
    image = wdpm.render(scene, FEW, threads=1)
    report = image.metadata["report"]
    assert image.layers["depth"].max() > 0.5
    assert report["nonfinite"].keys() >= {"direct"}
    assert all(np.isfinite(layer).all() for layer in image.layers.values())


def test_a_lamp_whose_power_overflows_is_told() -> None:
    """A lamp near the largest float, and larger than the scene's half side: no float holds a photon's flux."""
    scene = cornell_box((12, 12))
    (lamp,) = (mesh for mesh in scene.meshes if mesh.emission)
    wide = (lamp.vertices - lamp.vertices.mean(axis=0)) * 9.0 + lamp.vertices.mean(axis=0)
    large = replace(lamp, vertices=wide, emission=(3e38, 3e38, 3e38))
    meshes = tuple(large if mesh is lamp else mesh for mesh in scene.meshes)
    image = wdpm.render(replace(scene, meshes=meshes), FEW, threads=1)
    assert any("there is no indirect light" in warning for warning in image.metadata["report"]["warnings"])
    assert all(np.isfinite(layer).all() for layer in image.layers.values())


def test_a_sound_scene_counts_nothing() -> None:
    image = wdpm.render(cornell_box((12, 12)), FEW, threads=1)
    assert image.metadata["report"]["nonfinite"] == {}
