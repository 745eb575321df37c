"""Meshes that others made, broken ones among them, and rays that go on for long."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from case import HardCase, Run
from placing import small
from rooms import box, scene, view

import wdpm
from wdpm.scenes import atrium
from wdpm.scenes.errors import SceneError
from wdpm.scenes.model.bsdfs import Conductor
from wdpm.scenes.model.scene import Material, Mesh, Scene

MESH_FILES = (".obj", ".ply", ".stl", ".glb", ".off")

TRIANGLES = 331_179
WITHOUT_AREA = 0.16
"""McGuire's conference room has so many triangles, and this share of them has no area."""

UNBOUNDED = (
    "Russian roulette lets a camera path survive a vertex with at most 0.95 (constants.SURVIVAL_MOST), so where more "
    "than sqrt(0.95) = 0.975 of the light is reflected, weights grow with the length of a path faster than paths get "
    "rare: the mean is right, but its variance has no bound, and most images are too dark. It would take a larger "
    "probability, as media have (0.999), and as many times more vertices between perfect mirrors"
)
"""Why light that is reflected a hundred times is not seen as bright as it is."""


def meshes_of_others(run: Run, folder: Path) -> None:
    """Each file gives an image that is sound, with the same bits in four cells, or one line that names the file."""
    refused = []
    for file in sorted(path for path in folder.rglob("*") if path.suffix.lower() in MESH_FILES):
        try:
            loaded = wdpm.load(file)
        except SceneError as error:
            refused.append(file.name)
            run.demand(f"{file.name} is refused by its name", file.name in str(error), str(error), "names the file")
            continue
        try:
            image = run.render(small(loaded, 24), photons=2_000, spp=1)
        except SceneError as error:  # nothing is left of it
            refused.append(file.name)
            run.demand(f"{file.name} is refused in one line", "\n" not in str(error), str(error), "one line")
            continue
        run.demand(f"{file.name} is seen", bool((image.layers["depth"] > 0).any()))
    run.note(f"Refused with one clear line each: {', '.join(refused)}.")


def _with_empty_triangles(whole: Scene, count: int) -> Scene:
    """The scene with `count` more triangles without area, spread among those of all meshes."""
    rng = np.random.default_rng(5)
    share = count / sum(len(mesh.faces) for mesh in whole.meshes)

    def padded(mesh: Mesh) -> Mesh:
        more = mesh.faces[rng.integers(0, len(mesh.faces), round(share * len(mesh.faces)))].copy()
        more[:, 2] = more[:, rng.integers(0, 2)]  # two corners are one vertex
        places = np.sort(rng.integers(0, len(mesh.faces) + 1, len(more)))
        return replace(mesh, faces=np.insert(mesh.faces, places, more, axis=0))

    return replace(whole, meshes=tuple(padded(mesh) for mesh in whole.meshes))


def a_sixth_without_area(run: Run) -> None:
    """As many triangles as in McGuire's conference room, and as many of them without area: none of these matters."""
    count = TRIANGLES if run.full else TRIANGLES // 20
    empty = round(WITHOUT_AREA * count)
    whole = small(atrium(count - empty), 48 if run.full else 12)
    chosen = {"photons": 50_000 if run.full else 2_000, "spp": 4 if run.full else 1}
    reference = run.render(whole, cells=1, **chosen)
    image = run.render(_with_empty_triangles(whole, empty), **chosen)
    dropped = image.metadata["report"]["guards"].get("triangles dropped", 0)
    run.check_share("triangles dropped", dropped, empty, 0.01)
    run.demand("the same bits as without them", image.digest() == reference.digest())


def hall_of_mirrors(run: Run, share: float) -> None:
    """A closed box of glowing mirrors: each reflection adds as much again, a hundred times and more."""
    mirror = Material("mirror", Conductor(specular_reflectance=(share,) * 3))
    what = scene(
        [box((1.0, 0.9, 1.1), inside=True, emission=(1.0, 1.0, 1.0))],
        view((0.2, 0.1, -0.3), (0.5, -0.3, 1.0), 70, 24 if run.full else 12),
        [mirror],
    )
    image = run.render(what, photons=0, caustic_photons=0, spp=256 if run.full else 64)
    run.check_share("radiance", image.pixels.mean(dtype=np.float64), 1.0 / (1.0 - share), 0.02 if run.full else 0.05)
    cut = image.metadata["report"]["guards"].get("camera paths cut", 0)
    run.check("camera paths cut at the limit of vertices", cut, 0, 0)


def _cases() -> Iterator[HardCase]:
    folder = os.environ.get("WDPM_SCENES", "")
    others = Path(folder) / "hard-meshes"
    if folder and others.is_dir():
        yield HardCase(
            name="meshes that others made",
            section=2,
            shows="broken, open, non-manifold and empty files, from trimesh's and libigl's collections",
            expected="an image, the same in any partition (symmetry), or one line that names the file",
            tolerance="none: every bit",
            measure=partial(meshes_of_others, folder=others),
            slow=True,
        )
    yield HardCase(
        name="a sixth of all triangles without area",
        section=2,
        shows="331,179 triangles (small: a twentieth) of which 16 % have no area, as in McGuire's conference room",
        expected="the image without them (symmetry)",
        tolerance="none: every bit",
        measure=a_sixth_without_area,
    )
    for share, name in ((0.9, "a hall of mirrors"), (0.99, "a hall of better mirrors")):
        yield HardCase(
            name=name,
            section=6,
            shows=f"a closed box of glowing mirrors of reflectance {share}",
            expected="Le / (1 - reflectance), by energy conservation; no path is cut at the limit of vertices",
            tolerance="2 % (small: 5 %): roulette makes lengths random, and one path's deviation is about its mean",
            measure=partial(hall_of_mirrors, share=share),
            slow=share > 0.9,
            limit=UNBOUNDED if share > 0.9 else "",
        )


CASES = tuple(_cases())
