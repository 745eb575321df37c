"""Path-traced furnaces and boxes, and means over seeds with what they may deviate by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from furnaces import Array, box, rendered, scene, view
from numpy.typing import NDArray

from wdpm.cluster.render_settings import Integrator
from wdpm.scenes import cornell_box
from wdpm.scenes.model.bsdfs import Bsdf, Conductor, Plastic, TwoSided
from wdpm.scenes.model.scene import Material, Mesh, Scene

PATH = {"integrator": Integrator.PATH, "all_effects": True}
SEEDS = 6


def mean_and_deviation(pixels: NDArray[np.float32]) -> tuple[Array, Array]:
    """Of pixels that all have the same expectation: their mean, and its deviation, by channel."""
    flat = pixels.reshape(-1, 3).astype(np.float64)
    return flat.mean(axis=0), flat.std(axis=0, ddof=1) / np.sqrt(len(flat))


def over_seeds(what: Scene, layers: str, **chosen: object) -> tuple[Array, Array]:
    """The mean of the sum of some layers, and its deviation, by channel, from independent renders."""
    means = []
    for seed in range(SEEDS):
        image = rendered(what, seed=seed, **chosen)
        means.append(sum(image.layers[name].mean(axis=(0, 1), dtype=np.float64) for name in layers.split()))
    return np.mean(means, axis=0), np.std(means, axis=0, ddof=1) / np.sqrt(SEEDS)


def assert_alike(one: tuple[Array, Array], other: tuple[Array, Array], share: float = 0.0) -> None:
    """Two means agree within 4.5 of their deviations, and `share` of them.

    Of few seeds the deviation itself is uncertain by a third: 4.5 then stand for the 3 of a known one.
    """
    allowed = 4.5 * np.hypot(one[1], other[1]) + share * other[0]
    assert (np.abs(one[0] - other[0]) <= allowed).all(), (one, other)


def furnace(albedo: float, *things: tuple[Mesh, Bsdf]) -> Scene:
    """A closed box that glows with radiance 1, and things in it: all radiance is 1 / (1 - albedo) if they are white."""
    what = scene(
        [box((1, 1, 1), inside=True, emission=(1.0, 1.0, 1.0))], view((0, 0, -0.9), (0, 0, 1), 60), (albedo,) * 3
    )
    meshes = [replace(mesh, material=1 + i) for i, (mesh, _) in enumerate(things)]
    materials = [Material(f"thing {i}", bsdf) for i, (_, bsdf) in enumerate(things)]
    return replace(what, meshes=(*what.meshes, *meshes), materials=(*what.materials, *materials))


def shiny_box() -> Scene:
    """The Cornell box, one block of plastic and one of rough metal."""
    what = cornell_box((16, 16))
    first = len(what.materials)
    more = (
        Material("plastic", TwoSided(Plastic((0.3, 0.5, 0.7)))),
        Material("metal", Conductor(alpha_u=0.3, alpha_v=0.3)),
    )
    new = {"tall block": first, "short block": first + 1}
    meshes = tuple(replace(mesh, material=new.get(mesh.name, mesh.material)) for mesh in what.meshes)
    return replace(what, meshes=meshes, materials=(*what.materials, *more))
