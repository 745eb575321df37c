"""Section 7: media at their limits."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
from beams import parallel, pilot_of
from case import Run, hard_case
from numpy.typing import NDArray
from optics import reflected_by_half_space
from rooms import GREY, box, quad, scene

from wdpm.scenes.model.bsdfs import Diffuse, Null
from wdpm.scenes.model.lights import DirectionalLight, PointLight
from wdpm.scenes.model.scene import Camera, Material, Medium, Scene, diffuse
from wdpm.scenes.model.transforms import scaling, translation
from wdpm.scenes.model.volumes import Volume

Array = NDArray[np.float64]
BLACK = diffuse("black", (0.0, 0.0, 0.0))
AWAY = replace(parallel((0, 0, -0.9), (0, 0, 1), 0.3, 8, up=(0, 1, 0)), medium=0)
"""Parallel rays along z within a medium."""


def mean(pixels: NDArray[np.float32]) -> Array:
    return np.asarray(pixels.mean(axis=(0, 1), dtype=np.float64))


def lamp_in(medium: Medium, camera: Camera = AWAY) -> Scene:
    """A black lamp of radiance 5 at z = 1, seen from within a medium without end."""
    return scene([quad((-1, -1, 1), (0, 2, 0), (2, 0, 0), 0, (5.0, 5.0, 5.0))], camera, [BLACK], media=[medium])


@hard_case(
    "Beer's law",
    section=7,
    shows="a lamp from within media of albedo 0 and optical depths of 1e-8 to 1e4",
    expected="exp(-depth)",
    tolerance="1e-6, and what half a rounding of the exponent makes; 0 below the least floats",
)
def beers_law(run: Run) -> None:
    for depth in (1e-8, 1e-4, 1.0, 20.0, 80.0, 200.0, 1e4):
        sigma = depth / 1.9
        image = run.render(
            lamp_in(Medium("soot", (sigma,) * 3, (0.0, 0.0, 0.0))),
            cells=4 if depth in (1e-8, 1e4) else 1,
            spp=1,
            photons=0,
            volume_photons=1000,
        )
        way = 1.9 - AWAY.near_clip
        exact = 5.0 * np.exp(-sigma * way)
        # Depth is a float32: at a depth of d, one rounding is 6e-8 d of the light; below 1e-37 floats lose digits.
        if exact > 1e-37:
            run.check_share(f"radiance at depth {depth:g}", mean(image.pixels), np.full(3, exact), 1e-6 + 3e-7 * depth)
        else:
            run.check(f"radiance at depth {depth:g}", mean(image.pixels), 0.0, 1e-37)


@hard_case(
    "optical depth 1e-8",
    section=7,
    shows="a room with a medium of albedo 1 that is hardly there, around camera and lamp",
    expected="the room without it",
    tolerance="1e-6: a float's rounding; 1e-5 for photons, of which one in 1e8 collides",
)
def thin(run: Run) -> None:
    wall = box((1, 1, 1), inside=True)
    lamp = PointLight("lamp", (0.5, 0.2, 0.0), (3.0, 2.0, 1.0), 0)
    fog = scene([wall], AWAY, [diffuse("wall", GREY)], [lamp], [Medium("thin", (1e-8,) * 3, (1.0, 1.0, 1.0))])
    empty = replace(fog, camera=replace(AWAY, medium=None), lights=(replace(lamp, medium=None),), media=())
    seen = [run.render(what, photons=2000, volume_photons=2000, spp=4) for what in (fog, empty)]
    run.check_share("direct light", seen[0].layers["direct"], seen[1].layers["direct"], 1e-6)
    # Next to no photon collides; none does in the same place twice.
    run.check_share("indirect light", mean(seen[0].layers["indirect"]), mean(seen[1].layers["indirect"]), 1e-5)
    run.check("light of the medium", seen[0].layers["volume"], 0.0, 1e-6)


def furnace(medium: Medium, albedo: float = 0.5) -> Scene:
    """A closed box that glows, full of a medium: radiance is emission / (1 - albedo) if the medium absorbs nothing."""
    wall = replace(box((1, 1, 1), inside=True, emission=(1.0, 1.0, 1.0)), interior=0, exterior=0, bounds=True)
    return scene([wall], AWAY, [diffuse("wall", (albedo,) * 3)], media=[medium])


@hard_case(
    "white fog in a furnace",
    section=7,
    shows="a closed glowing box full of a medium of albedo 1, the camera in it",
    expected="emission / (1 - albedo) of the walls, at any depth and phase function: equilibrium",
    tolerance="4 deviations of the number of paths: 2 to 10 %; none escapes",
)
def white_fog(run: Run) -> None:
    every = ((0.5, 0.0), (3.0, 0.0), (3.0, -0.6), (3.0, 0.9), (20.0, 0.0))
    for sigma, g in every if run.full else every[:2]:
        what = furnace(Medium("milk", (sigma,) * 3, (1.0, 1.0, 1.0), g))
        wide = parallel((0, 0, -0.9), (0, 0, 1), 0.8, 8, up=(0, 1, 0))
        photons = round((1_000_000 if run.full else 40_000) / max(1.0, sigma / 3.0))  # the fog has sigma times as many
        image = run.render(
            replace(what, camera=replace(wide, medium=0)),
            cells=4 if sigma == 3.0 else 1,
            photons=photons,
            volume_photons=photons,
            k=200,
            spp=8,
        )
        # One deviation at 40,000 paths, from the spread of seeds: paths leave many photons each, and a phase function
        # of g = 0.9 weighs them from 1/20 to 200.
        deviation = (0.07 if abs(g) > 0.8 else 0.025) * sqrt(40_000 / photons)
        run.check_share(f"radiance, extinction {sigma:g}, g {g:g}", mean(image.pixels), np.full(3, 2.0), 4 * deviation)
        energy = image.metadata["report"]["energy"]
        run.check("escaped, of what was emitted", energy["escaped"] / energy["emitted"], 0.0, 0.0)


@hard_case(
    "optical depth 1e4, albedo 1",
    section=7,
    shows="photons that scatter ten thousand times each in a closed black box that glows, the camera among them",
    expected="all energy at the walls, none outside",
    tolerance="none outside; some 1 % of light is scattered more than 65,535 times, and is cut and counted: "
    "10 % of few paths",
)
def dense_white_fog(run: Run) -> None:
    what = furnace(Medium("milk", (5e3,) * 3, (1.0, 1.0, 1.0)), 0.0)
    with pilot_of(64 if run.full else 8):
        image = run.render(what, photons=0, volume_photons=500_000 if run.full else 50_000, volume_radius=0.1, spp=1)
    energy = image.metadata["report"]["energy"]
    run.check("escaped, of what was emitted", energy["escaped"] / energy["emitted"], 0.0, 0.0)
    run.check("cut at the limit of bounces", energy["travelling"] / energy["emitted"], 0.0, 0.1)
    run.note("a dozen photons lie within a free path of the camera: the radiance, 1 in the mean, is noise")


@hard_case(
    "half space",
    section=7,
    shows="a block of optical depth 1e4 in the sun",
    expected="Chandrasekhar's H functions, solved by iteration",
    tolerance="4 deviations of the number of paths: 2 to 4 %, at the small size 5 %",
)
def half_space(run: Run) -> None:
    cosine = 0.5
    block = replace(box((1, 1, 0.5), (0, 0, 0.5), 0), interior=0, bounds=True)
    sun = DirectionalLight("sun", (sqrt(1 - cosine**2), 0.0, cosine), (1.0, 1.0, 1.0))
    camera = parallel((0, 0, -1), (0, 0, 0), 0.5, 8, up=(0, 1, 0))
    for albedo in (0.2, 0.8, 0.99) if run.full else (0.8,):
        for depth in (1e4, 50.0) if run.full else (1e4,):
            medium = Medium("paper", (depth,) * 3, (albedo,) * 3)
            what = scene([block], camera, [Material("boundary", Null())], [sun], [medium])
            image = run.render(
                what, photons=0, volume_photons=1_600_000 if run.full else 40_000, volume_radius=0.05, spp=4
            )
            exact = reflected_by_half_space(albedo, cosine, 1.0)
            # A quarter of the paths is seen, and what each leaves lies in one place: from the spread of ten seeds.
            deviation = 2.0 / (1.0 - albedo) ** 0.25 / sqrt(image.metadata["report"]["volume"]["paths"])
            run.check_share(f"albedo {albedo}, depth {depth:g}", mean(image.pixels), np.full(3, exact), 4 * deviation)


@hard_case(
    "no way out of a dense medium",
    section=7,
    shows="collisions within a float's rounding of a wall",
    expected="no photon beyond the wall",
    tolerance="none",
)
def nothing_leaks(run: Run) -> None:
    wall = box((1, 1, 1), inside=True)
    lamp = PointLight("lamp", (0.75, 0.1, 0.0), (3.0, 2.0, 1.0), 0)
    for sigma in (3.0, 300.0, 1e4):
        what = scene(
            [wall], AWAY, [Material("wall", Diffuse((0.9,) * 3))], [lamp], [Medium("ink", (sigma,) * 3, (0.9,) * 3)]
        )
        image = run.render(
            what, photons=20_000 if run.full else 2000, volume_photons=100_000 if run.full else 20_000, spp=1
        )
        run.check(f"escaped at extinction {sigma:g}", image.metadata["report"]["energy"]["escaped"], 0.0, 0.0)


def grid(values: Array, half: float, **chosen: bool) -> Volume:
    """Fills a cube about the origin."""
    corner = translation((-half,) * 3) @ scaling((2 * half,) * 3)
    return Volume("grid", values[..., None].astype(np.float32), corner, **chosen)


@hard_case(
    "grids at their limits",
    section=7,
    shows="a lamp through a heterogeneous medium: one layer of voxels, none, and of densities 1e-6 to 1e6",
    expected="exp(-depth), the depth a sum over voxels",
    tolerance="1e-6, and what half a rounding of the exponent makes",
)
def grids_at_limits(run: Run) -> None:
    shell = np.zeros((256, 2, 2))
    shell[177] = 40.0
    range_of_12 = 10.0 ** np.random.default_rng(1).uniform(-6.0, 6.0, (64, 1, 1))
    half = 1.2
    for name, values, depth in (
        ("a shell of one voxel in 256", shell, 40.0 * 2 * half / 256),
        ("no density", np.zeros((20, 20, 20)), 0.0),
        ("densities from 1e-6 to 1e6", range_of_12, None),
    ):
        spread = values if depth is not None else values / (values.sum() * 2 * half / 64) * 3.0
        whole = 3.0 if depth is None else depth
        medium = Medium("soot", (1.0, 0.5, 0.1), (0.0,) * 3, density=grid(spread, half, nearest=True))
        # The whole grid lies between the camera and the lamp.
        camera = replace(parallel((0, 0, -1.3), (0, 0, 1), 0.3, 8, up=(0, 1, 0)), medium=0)
        lamp = quad((-1, -1, 1.3), (0, 2, 0), (2, 0, 0), 0, (5.0, 5.0, 5.0))
        what = scene([lamp], camera, [BLACK], media=[medium])
        image = run.render(what, cells=4, spp=1, photons=0, volume_photons=1000)
        exact = 5.0 * np.exp(-whole * np.array(medium.sigma_t))
        run.check_share(f"radiance through {name}", mean(image.pixels), exact, 1e-6 + 3e-7 * whole)


@hard_case(
    "white smoke in a furnace",
    section=7,
    shows="a closed glowing box full of a heterogeneous medium of albedo 1, the camera in it",
    expected="emission / (1 - albedo) of the walls: equilibrium",
    tolerance="4 deviations of the number of paths and 1 % for the blur of beams; none escapes",
)
def white_smoke(run: Run) -> None:
    for most in (4.0, 40.0) if run.full else (4.0,):
        values = np.random.default_rng(2).uniform(-most, most, (12, 12, 12)).clip(0.0)
        what = furnace(Medium("smoke", (1.0,) * 3, (1.0,) * 3, 0.3, grid(values, 1.01)))
        wide = parallel((0, 0, -0.9), (0, 0, 1), 0.8, 8, up=(0, 1, 0))
        photons = round((400_000 if run.full else 40_000) / max(1.0, most / 4.0))
        image = run.render(
            replace(what, camera=replace(wide, medium=0)),
            cells=4,
            photons=photons,
            volume_photons=photons,
            k=200,
            spp=8,
        )
        deviation = 0.025 * sqrt(40_000 / photons)
        # Beams blur what they gather over their radius, into places without density too: the sum stays.
        run.check_share(f"radiance, density up to {most:g}", mean(image.pixels), np.full(3, 2.0), 4 * deviation + 0.01)
        energy = image.metadata["report"]["energy"]
        run.check("escaped, of what was emitted", energy["escaped"] / energy["emitted"], 0.0, 0.0)
