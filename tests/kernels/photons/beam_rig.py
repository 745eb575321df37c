"""Beams through photons, and the kernel's sums over them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.features import Features
from wdpm.kernels.materials import medium
from wdpm.kernels.photons import photon_map
from wdpm.kernels.photons.beam import Beams, make_add_beams, sum_unit
from wdpm.kernels.rays import cells

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


Floats = NDArray[np.float32]
SIGMA_T = np.array([[0.3, 0.6, 1.2], [0.0, 0.1, 2.0], [5.0, 5.0, 5.0]], np.float32)
G = np.array([0.0, 0.7, -0.4], np.float32)
RADIUS = 0.15
UNIT = sum_unit(2.0, RADIUS, 0.7)
PAD = 1e-4
# A top tree of four cells, whose planes go through many of the photons and beams below.
AXIS = np.array([0, 1, 2], np.int32)
SPLIT = np.array([0.0, 0.25, -0.25], np.float32)


@dataclass
class Photons:
    position: Floats
    flux: Floats
    medium: NDArray[np.int64]
    direction: Floats

    def some(self, which: Any) -> Photons:
        return Photons(self.position[which], self.flux[which], self.medium[which], self.direction[which])


@dataclass
class Stretches:
    origin: Floats
    direction: Floats
    length: Floats
    medium: NDArray[np.int32]
    start: Floats = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    end: Floats = field(default_factory=lambda: np.zeros((0, 3), np.float32))

    def normals(self, name: str) -> Floats:
        """Of the surfaces at one end; zero where none are given."""
        given: Floats = getattr(self, name)
        return given if len(given) else np.zeros_like(self.origin)


def unit_vectors(rng: np.random.Generator, count: int) -> Floats:
    d = rng.normal(size=(count, 3))
    return (d / np.linalg.norm(d, axis=1)[:, None]).astype(np.float32)


def upload(s: Stretches) -> Any:
    count = len(s.length)
    beams = Beams()
    beams.origin = wp.array(s.origin, dtype=wp.vec3, device="cpu")
    beams.direction = wp.array(s.direction, dtype=wp.vec3, device="cpu")
    beams.length = wp.array(s.length, dtype=wp.float32, device="cpu")
    for name in ("start", "end"):
        setattr(beams, name, wp.array(s.normals(name), dtype=wp.vec3, device="cpu"))
    beams.medium = wp.array(s.medium, dtype=wp.int32, device="cpu")
    for name in ("red", "green", "blue"):
        setattr(beams, name, wp.zeros(count, dtype=wp.int64, device="cpu"))
    beams.clamped = wp.zeros(count, dtype=wp.int32, device="cpu")
    return beams


def tagged(number: NDArray[np.int64]) -> Floats:
    """What volume photons have in place of a normal, shape [N, 3]."""
    normal = np.zeros((len(number), 3), np.float32)
    normal[:, 0] = number
    return normal


def add(
    beams: Any,
    photons: Photons,
    own_cell: int = 0,
    top: tuple[NDArray[np.int32], Floats] = (AXIS[:0], SPLIT[:0]),
    radius: float = RADIUS,
    unit: float = UNIT,
    media: tuple[Floats, Floats] = (SIGMA_T, G),
) -> None:
    """Launch the kernel for one cell's photons."""
    ids = np.arange(len(photons.position))
    tree = photon_map.build(photons.position, photons.flux, tagged(photons.medium), photons.direction, ids)
    sigma_t, g = media
    table = medium.upload_homogeneous(sigma_t, np.ones_like(sigma_t), g, "cpu")
    inputs = [tree, table, cells.upload(*top, PAD, "cpu"), beams, own_cell, radius, unit, 0]
    wp.launch(make_add_beams(Features(media=True)), dim=len(beams.length), inputs=inputs, device="cpu")


def sums(beams: Any) -> NDArray[np.int64]:
    """Shape [beams, 3]."""
    return np.stack([beams.red.numpy(), beams.green.numpy(), beams.blue.numpy()], axis=1)
