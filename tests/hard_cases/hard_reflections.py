"""Section 5: photon paths that reflect very often, and boxes that lose nothing."""

from __future__ import annotations

from math import pi

import numpy as np
from beams import ALBEDO, INTENSITY, POWER, SCREEN_AREA, beam, parallel, pilot_of, screen
from case import Run, hard_case, mean
from numpy.typing import NDArray
from rooms import GREY, box, glowing_box, quad, scene, view

from wdpm.scenes.model.bsdfs import Conductor
from wdpm.scenes.model.lights import PointLight, SpotLight
from wdpm.scenes.model.scene import Material, Scene, diffuse
from wdpm.scenes.model.transforms import look_at

Array = NDArray[np.float64]


def between_mirrors(reflectance: float, gap: float) -> Scene:
    """A slit between two mirrors of length 1; a beam at 45 degrees leaves it after 1 / gap reflections."""
    slope = quad((0.0, -0.5, 0.0), (1.0, 0, 0), (0, 1.0, 0), 1, name="below")
    above = quad((0.0, -0.5, gap), (0, 1.0, 0), (1.0, 0, 0), 1, name="above")
    light = beam((0.0, 0.0, gap / 2), (1.0, 0.0, 1.0 + gap / 2))
    materials = [
        diffuse("screen", (ALBEDO,) * 3),
        Material("mirror", Conductor(specular_reflectance=(reflectance,) * 3)),
    ]
    return scene([screen(1.2), slope, above], parallel((1.1, 0, 0.5), (1.2, 0, 0.5), 0.05, 4), materials, [light])


@hard_case(
    "10,000 reflections",
    section=5,
    shows="photons that leave a slit after 10,000 reflections of 1 and of 1 - 1e-4 (small: 1,000, of 1 - 1e-3)",
    expected="all light, and (1 - 1e-4)^10,000 = 0.3679 of it, over the area of a screen",
    tolerance="0.5 %: surface points; 4 deviations of a binomial number of photons",
)
def ten_thousand_reflections(run: Run) -> None:
    exact = ALBEDO / pi * POWER / SCREEN_AREA
    chosen = {"photons": 0, "caustic_k": 500, "caustic_radius": 1e3, "spp": 1}
    gap = 1e-4 if run.full else 1e-3
    with pilot_of(64):
        image = run.render(between_mirrors(1.0, gap), caustic_photons=8, **chosen)
        run.check_share("all light arrives", mean(image, "caustic"), exact, 5e-3)
        many = 200  # surely fewer than k of them arrive
        image = run.render(between_mirrors(1.0 - gap, gap), cells=1, caustic_photons=many, **chosen)
        # Each photon arrives with probability e^-1, and unchanged.
        noise = np.sqrt((np.e - 1) / (np.e * many))
        run.check_share(f"e^-1 of it, at {gap:g} lost each time", mean(image, "caustic"), exact * np.exp(-1), 4 * noise)


@hard_case(
    "endless reflections",
    section=5,
    shows="a beam straight to and fro between perfect mirrors",
    expected="under way at the limit of 65,535 bounces, or out beside the mirrors; nothing is absorbed but the "
    "light of a lamp in a room apart, and nothing is lost",
    tolerance="0.1 % of the lamp: its photons are a whole number",
)
def endless_reflections(run: Run) -> None:
    below = quad((-1, -1, 0.0), (2, 0, 0), (0, 2, 0), 1, name="below")
    above = quad((-1, -1, 0.1), (0, 2, 0), (2, 0, 0), 1, name="above")
    narrow = SpotLight("beam", look_at((0, 0, 0.05), (0, 0, 1), (0, 1, 0)), INTENSITY, 0.05, 0.05)
    intensity = 1e-6  # of a lamp in a room of its own: where nothing lands, no photon is traced after the pilot
    what = scene(
        [box((1, 1, 0.4), (0, 0, -0.6), inside=True), below, above],
        parallel((0, 0, -0.7), (0, 0, -1.0), 0.1, 4),
        [diffuse("walls", GREY), Material("mirror", Conductor())],
        [narrow, PointLight("lamp", (0.0, 0.0, -0.7), (intensity,) * 3)],
    )
    with pilot_of(64):
        image = run.render(what, photons=2_000, caustic_photons=0, spp=1)
    report = image.metadata["report"]
    energy = report["energy"]
    cut = report["guards"].get("photon paths cut", 0)
    run.demand("some photons are cut at the limit of bounces", cut > 0, f"{cut}", "at least 1")
    run.demand("their energy is told", energy["travelling"] > 0, f"{energy['travelling']:.3g} W", "above 0")
    run.check_share("absorbed: the light of the room alone", energy["absorbed"], 4.0 * np.pi * intensity, 1e-3)


@hard_case(
    "closed white box",
    section=6,
    shows="a closed box of albedo exactly 1 without a depth limit",
    expected="it ends; all energy is in the ledger",
    tolerance="1e-6",
    slow=True,
)
def closed_white_box(run: Run) -> None:
    what = scene(
        [box(inside=True)],
        view((0.2, 0.1, -0.3), (0.5, -0.3, 1.0), 70),
        [diffuse("white", (1.0, 1.0, 1.0))],
        [PointLight("lamp", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))],
    )
    with pilot_of(1):
        image = run.render(what, cells=4 if run.full else 1, photons=1000, spp=1)
    energy = image.metadata["report"]["energy"]
    run.check_share("under way at the limit of bounces", energy["travelling"], energy["emitted"], 1e-6)


@hard_case(
    "white box to a depth",
    section=6,
    shows="a closed box of albedo exactly 1 that glows, to depths of 2 to 12",
    expected="indirect light of depth - 2 times the emission: each bounce adds it once more",
    tolerance="4 %: 8,000 photons, a third of which is seen",
)
def white_box_to_a_depth(run: Run) -> None:
    glow = glowing_box((1.0, 1.0, 1.0))
    for depth in (2, 3, 6, 12):
        image = run.render(glow, photons=60_000 if run.full else 8_000, k=200, spp=4, max_depth=depth)
        run.check_share(f"indirect light to depth {depth}", mean(image, "indirect"), np.full(3, depth - 2.0), 0.04)
