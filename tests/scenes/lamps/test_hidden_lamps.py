"""Lamps in the plane of another surface: they are seen, whatever comes first in the file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.flat.lamps.hidden import hides_lamps
from wdpm.scenes.model.scene import Camera, Mesh, Scene, diffuse
from wdpm.scenes.model.transforms import look_at

SLANTED = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]


def square(name: str, half: float, height: float, turn: NDArray[np.float64], glow: float = 0.0, x: float = 0.0) -> Mesh:
    """Across z; turned in the end."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * half + (x, 0.2, height)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return Mesh(name, corners @ turn.T, faces, None, None, 0, (glow, glow, glow) if glow else None)


def scene(*meshes: Mesh) -> Scene:
    camera = Camera(look_at((0.0, 0.0, 9.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)), 40.0, 8, 8)
    return Scene("ceiling", meshes, (diffuse("white", (0.5, 0.5, 0.5)),), (), camera)


@pytest.mark.parametrize("turn", [np.eye(3), SLANTED], ids=["along the axes", "slanted"])
def test_a_lamp_in_a_ceiling_is_numbered_first(turn: NDArray[np.float64]) -> None:
    ceiling, lamp = square("ceiling", 3.0, 1.0, turn), square("lamp", 0.5, 1.0, turn, 5.0)
    flat = flatten(scene(square("floor", 3.0, -1.0, turn), ceiling, lamp))
    assert (flat.triangles.emitter >= 0).tolist() == [True, True, False, False, False, False]
    assert flat.lights.prim.tolist() == [0, 1]
    assert not hides_lamps(flat.triangles)


@pytest.mark.parametrize(
    "lamp",
    [
        square("below", 0.5, 0.99, np.eye(3), 5.0),
        square("beside", 0.5, 1.0, np.eye(3), 5.0, x=4.0),
        square("dark", 0.5, 1.0, np.eye(3)),
    ],
    ids=lambda mesh: mesh.name,
)
def test_others_keep_their_numbers(lamp: Mesh) -> None:
    ceiling = square("ceiling", 3.0, 1.0, np.eye(3))
    flat = flatten(scene(ceiling, lamp))
    assert not (flat.triangles.emitter[:2] >= 0).any()


def test_a_ceiling_behind_its_lamp_hides_none() -> None:
    lamp, ceiling = square("lamp", 0.5, 1.0, np.eye(3), 5.0), square("ceiling", 3.0, 1.0, np.eye(3))
    assert not hides_lamps(flatten(scene(lamp, ceiling)).triangles)


def test_a_lamp_of_many_that_is_covered_is_found() -> None:
    lamps = [square(f"lamp {number}", 0.1, 1.0, np.eye(3), 1.0, x=number - 10.0) for number in range(20)]
    ceiling = square("ceiling", 0.3, 1.0, np.eye(3), x=5.0)
    flat = flatten(scene(ceiling, *lamps))
    assert (flat.triangles.emitter[:40] >= 0).all()
    assert not (
        flatten(scene(replace(ceiling, vertices=ceiling.vertices + 0.3), *lamps)).triangles.emitter[:2] >= 0
    ).any()


def test_a_curved_lamp_is_in_no_plane() -> None:
    """Whatever else shines: here the very first triangle."""
    first = Mesh("first", np.eye(3), np.array([[0, 1, 2]]), None, None, 0, (1.0, 1.0, 1.0))
    corners = np.array([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1.5]]) * 0.5
    bent = Mesh("bent", corners, np.array([[0, 1, 2], [0, 2, 3]]), None, None, 0, (1.0, 1.0, 1.0))
    ceiling = square("ceiling", 3.0, 0.5, np.eye(3))
    assert not hides_lamps(flatten(scene(first, ceiling, bent)).triangles)
