"""Section 7: media at their limits."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
from beams import parallel, pilot_of
from case import HardCase, Run
from numpy.typing import NDArray
from optics import reflected_by_half_space
from rooms import GREY, box, quad, scene

from wdpm.scenes.model.bsdfs import Diffuse, Null
from wdpm.scenes.model.lights import DirectionalLight, PointLight
from wdpm.scenes.model.scene import Camera, Material, Medium, Scene, diffuse

Array = NDArray[np.float64]
BLACK = diffuse("black", (0.0, 0.0, 0.0))
AWAY = replace(parallel((0, 0, -0.9), (0, 0, 1), 0.3, 8, up=(0, 1, 0)), medium=0)
"""Parallel rays along z within a medium."""


def mean(pixels: NDArray[np.float32]) -> Array:
    return np.asarray(pixels.mean(axis=(0, 1), dtype=np.float64))


def lamp_in(medium: Medium, camera: Camera = AWAY) -> Scene:
    """A black lamp of radiance 5 at z = 1, seen from within a medium without end."""
    return scene([quad((-1, -1, 1), (0, 2, 0), (2, 0, 0), 0, (5.0, 5.0, 5.0))], camera, [BLACK], media=[medium])


def beers_law(run: Run) -> None:
    """A lamp at a distance of 1.9 through media of albedo 0, from optical depths of 1e-8 to 1e4."""
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


def thin(run: Run) -> None:
    """An optical depth of 1e-8 and albedo 1: the image of empty space, to a float's rounding."""
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


def white_fog(run: Run) -> None:
    """Albedo 1: what scatters is in equilibrium with the walls, whatever its depth and phase function."""
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


def dense_white_fog(run: Run) -> None:
    """An optical depth of 1e4 and albedo 1 around the camera: photons scatter 1e4 times, and none gets out."""
    what = furnace(Medium("milk", (5e3,) * 3, (1.0, 1.0, 1.0)), 0.0)
    with pilot_of(64 if run.full else 8):
        image = run.render(what, photons=0, volume_photons=500_000 if run.full else 50_000, volume_radius=0.1, spp=1)
    energy = image.metadata["report"]["energy"]
    run.check("escaped, of what was emitted", energy["escaped"] / energy["emitted"], 0.0, 0.0)
    run.check("cut at the limit of bounces", energy["travelling"] / energy["emitted"], 0.0, 0.1)
    run.note("a dozen photons lie within a free path of the camera: the radiance, 1 in the mean, is noise")


def half_space(run: Run) -> None:
    """A block of optical depth 1e4 lit by the sun: Chandrasekhar's solution for a medium that fills half of space."""
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


def nothing_leaks(run: Run) -> None:
    """A lamp in a closed room full of a dense medium: no photon gets through the walls from within it."""
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


CASES = (
    HardCase(
        name="Beer's law",
        section=7,
        shows="a lamp from within media of albedo 0 and optical depths of 1e-8 to 1e4",
        expected="exp(-depth)",
        tolerance="1e-6, and what half a rounding of the exponent makes; 0 below the least floats",
        measure=beers_law,
    ),
    HardCase(
        name="optical depth 1e-8",
        section=7,
        shows="a room with a medium of albedo 1 that is hardly there, around camera and lamp",
        expected="the room without it",
        tolerance="1e-6: a float's rounding; 1e-5 for photons, of which one in 1e8 collides",
        measure=thin,
    ),
    HardCase(
        name="white fog in a furnace",
        section=7,
        shows="a closed glowing box full of a medium of albedo 1, the camera in it",
        expected="emission / (1 - albedo) of the walls, at any depth and phase function: equilibrium",
        tolerance="4 deviations of the number of paths: 2 to 10 %; none escapes",
        measure=white_fog,
    ),
    HardCase(
        name="optical depth 1e4, albedo 1",
        section=7,
        shows="photons that scatter ten thousand times each in a closed black box that glows, the camera among them",
        expected="all energy at the walls, none outside",
        tolerance="none outside; some 1 % of light is scattered more than 65,535 times, and is cut and counted: "
        "10 % of few paths",
        measure=dense_white_fog,
    ),
    HardCase(
        name="half space",
        section=7,
        shows="a block of optical depth 1e4 in the sun",
        expected="Chandrasekhar's H functions, solved by iteration",
        tolerance="4 deviations of the number of paths: 2 to 4 %, at the small size 5 %",
        measure=half_space,
    ),
    HardCase(
        name="no way out of a dense medium",
        section=7,
        shows="collisions within a float's rounding of a wall",
        expected="no photon beyond the wall",
        tolerance="none",
        measure=nothing_leaks,
    ),
)
