"""Section 5: photon maps and gathers at their limits."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from unittest.mock import patch

import numpy as np
import warp as wp
from beams import ALBEDO, INTENSITY, POWER, SCREEN_AREA, beam, mirrored_beam, on_screen, parallel, screen
from case import Run, hard_case, mean, mean_of
from numpy.typing import NDArray
from rooms import GREY, box, lit_room, quad, scene, triangles, view

from wdpm.cluster.plan import map_plans
from wdpm.kernels.constants import MAX_GATHER_RADIUS, MIN_GATHER_RADIUS
from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons import photon_map
from wdpm.kernels.photons.gather import gather_kernel
from wdpm.scenes.model.lights import DirectionalLight, PointLight, SpotLight
from wdpm.scenes.model.scene import diffuse
from wdpm.scenes.model.transforms import look_at

Array = NDArray[np.float64]
WIDE = 1e3
"""A gather radius far above the scene's size."""


# Maps of few photons


def _whole_screen(run: Run, **chosen: object) -> None:
    """Gathers that hold the whole map and the whole screen: flux over area."""
    image = run.render(mirrored_beam(on_screen()), photons=100, caustic_radius=WIDE, spp=1, **chosen)
    exact = ALBEDO / pi * POWER / SCREEN_AREA
    run.check_share("caustic", image.layers["caustic"], np.broadcast_to(exact, image.pixels.shape), 5e-3)
    run.check("indirect", image.layers["indirect"], 0.0, 0.0)


@hard_case(
    "k above the map",
    section=5,
    shows="200 photons, all on one screen, gathers of 500 and a radius of 500 scene sizes",
    expected="flux over area, times albedo over pi: every gather holds everything",
    tolerance="0.5 %: the count of surface points that tells the area is stratified, not exact",
)
def k_above_the_map(run: Run) -> None:
    _whole_screen(run, caustic_photons=200, caustic_k=500)


@hard_case(
    "one photon",
    section=5,
    shows="a map of one photon, gathers of 500 and of 2",
    expected="its flux over the area of the screen",
    tolerance="0.5 %, as above",
)
def one_photon(run: Run) -> None:
    _whole_screen(run, caustic_photons=1, caustic_k=500)
    _whole_screen(run, caustic_photons=1, caustic_k=2)  # the pilot may ask for two paths


@hard_case(
    "the largest radius",
    section=5,
    shows="a gather radius of 2^58 scene units",
    expected="flux over area",
    tolerance="0.5 %, as above",
)
def largest_radius(run: Run) -> None:
    image = run.render(
        mirrored_beam(on_screen()), photons=0, caustic_photons=100, caustic_k=500, caustic_radius=MAX_GATHER_RADIUS / 4
    )
    exact = ALBEDO / pi * POWER / SCREEN_AREA
    run.check_share("caustic", image.layers["caustic"], np.broadcast_to(exact, image.pixels.shape), 5e-3)


@hard_case(
    "empty map",
    section=5,
    shows="no photons at all",
    expected="no indirect light; direct light bit for bit as with photons",
    tolerance="none",
)
def no_photons(run: Run) -> None:
    room = lit_room()
    dark = run.render(room, photons=0, spp=4)
    lit = run.render(room, photons=2000, spp=4)
    run.check("indirect light of an empty map", dark.layers["indirect"], 0.0, 0.0)
    run.demand("direct light has the same bits", np.array_equal(dark.layers["direct"], lit.layers["direct"]))
    run.demand("there is indirect light with photons", bool(lit.layers["indirect"].any()))


@hard_case(
    "no photon lands",
    section=5,
    shows="all photon paths leave the scene",
    expected="intensity over distance squared times albedo over pi, no indirect light, and a warning",
    tolerance="1e-4: the view is 0.004 across at a distance of 1",
)
def nothing_lands(run: Run) -> None:
    wall = screen(1.0)
    lamp = PointLight("lamp", (0.0, 0.0, 0.0), (3.0, 2.0, 1.0))
    image = run.render(scene([wall], on_screen(0.002), [diffuse("screen", GREY)], [lamp]), photons=5000, spp=4)
    run.check_share("direct", mean(image, "direct"), 0.5 / pi * np.array((3.0, 2.0, 1.0)), 1e-4)
    run.check("indirect", image.layers["indirect"], 0.0, 0.0)
    run.check("photons stored", image.metadata["report"]["photons"]["stored"], 0, 0)
    warned = any("no indirect light" in text for text in image.metadata["report"]["warnings"])
    run.demand("the report says so", warned)


# Gathers, at photons that are placed by hand


def gathered(places: Array, queries: Array, k: int, radius: float) -> tuple[Array, NDArray[np.int32]]:
    """Irradiance [1 / unit²] and count at queries on z = 0, of photons of flux 1 that came from above."""
    up = np.array([[0.0, 0.0, 1.0]], np.float32)
    many = len(places)
    built = photon_map.build(
        places.astype(np.float32),
        np.ones((many, 3), np.float32),
        np.repeat(up, many, axis=0),
        np.repeat(up, many, axis=0),
        np.arange(many, dtype=np.int64),
        device="cpu",
    )
    count = len(queries)
    at, facing = (
        wp.array(x.astype(np.float32), dtype=wp.vec3, device="cpu") for x in (queries, np.tile(up, (count, 1)))
    )
    irradiance = wp.zeros(count, dtype=wp.vec3, device="cpu")
    used = wp.zeros(count, dtype=wp.int32, device="cpu")
    Launcher("cpu")(
        gather_kernel,
        count,
        photons=built,
        position=at,
        normal=facing,
        shading_normal=facing,
        k=k,
        r_max=radius,
        r_least=0.0,
        run=1,
        irradiance_out=irradiance,
        count_out=used,
        radius_out=wp.zeros(count, dtype=wp.float32, device="cpu"),
        truncated_out=wp.zeros(count, dtype=wp.bool, device="cpu"),
    )
    return irradiance.numpy()[:, 0].astype(np.float64), used.numpy()


def on_plane(xy: Array) -> Array:
    return np.column_stack([xy, np.zeros(len(xy))])


@hard_case(
    "k = 1",
    section=5,
    shows="gathers of the nearest photon alone, whose variance is infinite",
    expected="the distribution of one over an area of gamma distribution, shape 2: all quantiles, not the mean",
    tolerance="0.01 of probability: 4 deviations of 10,000 queries that share photons",
)
def one_nearest(run: Run) -> None:
    count = 400_000 if run.full else 40_000
    rng = np.random.default_rng(5)
    queries = rng.uniform(0.1, 0.9, (count // 4, 2))
    found, _ = gathered(on_plane(rng.random((count, 2))), on_plane(queries), 1, 10.0)
    run.demand("all finite", bool(np.isfinite(found).all()))
    # P(estimate < x D) = P(area > 1 / x D) = (1 + 1/x) exp(-1/x).
    for x in (0.25, 0.5, 1.0, 2.0, 8.0):
        run.check(
            f"share of estimates below {x} of the density",
            (found < x * count).mean(),
            (1 + 1 / x) * np.exp(-1 / x),
            0.01,
        )


@hard_case(
    "all photons in one place",
    section=5,
    shows="51 to 20,000 photons at one point, seen from 0.4 to 1e-6 away and from the point itself",
    expected="k over pi r²; finite at the point; at most k photons: over the disc of the largest radius",
    tolerance="1e-5: float32",
)
def all_in_one_place(run: Run) -> None:
    k, radius = 50, 0.5
    distance = np.array([0.4, 0.1, 1e-2, 1e-4, 1e-6])
    queries = on_plane(np.column_stack([distance, np.zeros(5)]))
    for many in (51, 1000, 20_000):
        found, count = gathered(np.zeros((many, 3)), queries, k, radius)
        run.check(f"photons counted of {many}", count, k, 0)
        run.check_share(f"irradiance, {many} in one place", found, k / (pi * distance**2), 1e-5)
        found, _ = gathered(np.zeros((many, 3)), np.zeros((1, 3)), k, radius)
        run.demand(
            f"finite at the place itself, of {many}", bool(np.isfinite(found).all()), f"{found[0]:.6g}", "finite"
        )
    found, count = gathered(np.zeros((k, 3)), np.vstack([queries, np.zeros((1, 3))]), k, radius)
    run.check_share("no more than k: over the whole disc", found, k / (pi * radius**2), 1e-5)


@hard_case(
    "equal distances",
    section=5,
    shows="1,024 photons, many of them the same, at one distance exactly",
    expected="k over pi r², whichever k of them",
    tolerance="1e-6: float32",
)
def equally_far(run: Run) -> None:
    step = 2.0**-6
    corners = [(3, 4), (4, 3), (5, 0), (0, 5)]  # all 5 away, in integers
    ring = np.array([(sx * x, sy * y) for x, y in corners for sx in (-1, 1) for sy in (-1, 1)], np.float64) * step
    rng = np.random.default_rng(8)
    places = on_plane(rng.permutation(ring.repeat(64, axis=0)))
    for k in (1, 7, 100, 500):
        found, count = gathered(places, np.zeros((1, 3)), k, 1.0)
        run.check(f"photons counted of k = {k}", count, k, 0)
        run.check_share(f"irradiance, k = {k}", found, k / (pi * (5 * step) ** 2), 1e-6)


@hard_case(
    "radius below float spacing, gathers",
    section=5,
    shows="photons one and three floats apart, radii down to the least",
    expected="one photon over pi r² at its very place, none a float away",
    tolerance="1e-5: float32",
)
def tiny_radius(run: Run) -> None:
    spacing = float(np.spacing(np.float32(1.0)))
    places = on_plane(1.0 + spacing * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 3.0]]))
    for radius in (MIN_GATHER_RADIUS, spacing / 16, spacing / 2):
        found, count = gathered(places, np.array([[1.0, 1.0, 0.0], [1.0 + 7 * spacing, 1.0, 0.0]]), 50, radius)
        run.check(f"photons within {radius:.1e}", count, [1, 0], 0)
        run.check_share(f"irradiance within {radius:.1e}", found, [1.0 / (pi * radius**2), 0.0], 1e-5)


@hard_case(
    "radius below float spacing",
    section=5,
    shows="a room with a gather radius of 1e-9",
    expected="no indirect light; all else bit for bit as without photons",
    tolerance="none",
)
def radius_below_spacing(run: Run) -> None:
    room = lit_room()
    with patch.object(map_plans, "POINTS_MOST", map_plans.POINTS_MOST if run.full else 1 << 17):  # 16 million take 10 s
        image = run.render(room, photons=2000, radius=1e-9, spp=1)
    without = run.render(room, photons=0, spp=1)
    run.check("indirect", image.layers["indirect"], 0.0, 0.0)
    run.demand("all else has the same bits", np.array_equal(image.pixels, without.pixels))


# Lights


@hard_case(
    "12 decades of beams",
    section=5,
    shows="two caustics, one 1e12 times weaker than the other",
    expected="flux over area on both screens",
    tolerance="the weak one keeps 2.5 % of 300 photons, 7.5 in the mean: 4 deviations of as many as there are",
)
def beams_of_12_decades(run: Run) -> None:
    weaker = 1e-12
    strong = mirrored_beam(on_screen())
    other_mirror = quad((-0.1, -0.5, -0.1), (0.2, 0, 0.2), (0, 0.2, 0), 1, name="other mirror")  # faces (-1, 0, 1)
    other_screen = quad((-1, -1, -1), (0, 2, 0), (0, 0, 2), name="other screen")  # at x = -1, faces x
    weak = replace(beam((0, -0.4, 1), (0, -0.4, 0)), name="weak", intensity=tuple(weaker * x for x in INTENSITY))
    both = replace(strong, meshes=(*strong.meshes, other_screen, other_mirror), lights=(*strong.lights, weak))
    exact = ALBEDO / pi * POWER / SCREEN_AREA
    chosen = {"photons": 0, "caustic_photons": 300, "caustic_k": 500, "caustic_radius": WIDE, "spp": 1}
    bright = run.render(both, **chosen)
    run.check_share("the strong one's screen", mean(bright, "caustic"), exact, 0.02)
    away = replace(both, camera=parallel((-0.3, 0, 0), (-1, 0, 0), 0.5))
    seeds = 64 if run.full else 8
    dim = np.mean([mean(run.render(away, cells=1, seed=seed, **chosen), "caustic") for seed in range(seeds)], axis=0)
    run.check_share("the weak one's screen", dim, weaker * exact, 4 * (7.5 * seeds) ** -0.5)


@hard_case(
    "12 decades of rooms",
    section=5,
    shows="two closed rooms, one of which glows 1e12 times less",
    expected="emission / (1 - albedo) in both",
    tolerance="2 % (small: 4 %): the weak room gets one in 40 of the photons and one in 32 of the shadow rays; 4 "
    "deviations of 32 (8) seeds, of 2.5 % each",
)
def rooms_of_12_decades(run: Run) -> None:
    weaker = 1e-12
    rooms = [
        box((1, 1, 1), (0, 0, 0), inside=True, emission=(1.0, 1.0, 1.0), name="strong room"),
        box((1, 1, 1), (4, 0, 0), inside=True, emission=(weaker,) * 3, name="weak room"),
    ]
    for name, factor, middle, seeds in (("strong", 1.0, 0.0, 1), ("weak", weaker, 4.0, 32 if run.full else 8)):
        what = scene(rooms, view((middle, 0, -0.3), (middle, 0, 1.0), 120), [diffuse("wall", GREY)])
        images = [
            run.render(what, cells=1 if seed else 4, seed=seed, photons=40_000, spp=64, light_samples=16)
            for seed in range(seeds)
        ]
        radiance = np.mean([mean_of(image.pixels) for image in images], axis=0)
        run.check_share(f"the {name} room", radiance, factor * 2.0 * np.ones(3), 0.02 if run.full else 0.04)


@hard_case(
    "12 decades of lamps",
    section=5,
    shows="a lamp 1e12 times weaker than that of the room",
    expected="the room without it: light adds up",
    tolerance="1 % in the mean; no pixel's direct light above 1.5 times: other random numbers, no spike",
)
def lamps_of_12_decades(run: Run) -> None:
    room = lit_room()
    faint = PointLight("faint", (0.5, -0.5, 0.5), (1e-12,) * 3)
    chosen = {"photons": 20_000, "spp": 16}
    with_it = run.render(replace(room, lights=(faint,)), **chosen)
    without = run.render(room, **chosen)
    run.check_share("mean", mean_of(with_it.pixels), mean_of(without.pixels), 0.01)
    ratio = with_it.layers["direct"] / np.maximum(without.layers["direct"], 1e-6)
    run.check("brightest pixel against the same without", ratio.max(), 1.0, 0.5)


@hard_case(
    "lights of nothing",
    section=5,
    shows="lamps of zero power and of zero area",
    expected="the very bits of the room without them",
    tolerance="none",
)
def lights_of_nothing(run: Run) -> None:
    room = lit_room()
    chosen = {"photons": 2000, "spp": 4}
    plain = run.render(room, **chosen)
    black = (0.0, 0.0, 0.0)
    down = look_at((0.0, 0.5, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0))
    for name, lamp in (
        ("a point of no intensity", PointLight("dark", (0.2, 0.2, 0.2), black)),
        ("a spot of no intensity", SpotLight("dark", down, black)),
        ("a sun of no irradiance", DirectionalLight("dark", (0.0, -1.0, 0.0), black)),
    ):
        image = run.render(replace(room, lights=(lamp,)), **chosen)
        run.demand(f"same bits with {name}", np.array_equal(image.pixels, plain.pixels))
    point = triangles([[[0.5, 0.5, 0.5]] * 3], emission=(5.0, 5.0, 5.0), name="a point's lamp")
    line = triangles(
        [[[0.5, 0.5, 0.5], [0.6, 0.5, 0.5], [0.8, 0.5, 0.5]]], emission=(5.0, 5.0, 5.0), name="a line's lamp"
    )
    image = run.render(replace(room, meshes=(*room.meshes, point, line)), **chosen)
    run.demand("same bits with lamps of no area", np.array_equal(image.pixels, plain.pixels))


DARKEST = 9.0 / 1266.0
"""Share of the room's lamp in all power: as often, at least, is it chosen for a shadow ray."""


@hard_case(
    "a light that sees nothing",
    section=5,
    shows="a bright lamp in a closed black chest within a room",
    expected="the room without the lamp; no photon of it in the map",
    tolerance="4 deviations of how often the room's lamp is chosen for a shadow ray; 4 % for other photons",
)
def blind_light(run: Run) -> None:
    room = lit_room()
    chest = box((0.1, 0.1, 0.1), (0.5, -0.8, 0.5), 1, inside=True, name="chest")
    hidden = PointLight("hidden", (0.5, -0.8, 0.5), (100.0, 100.0, 100.0))
    black = diffuse("black", (0.0, 0.0, 0.0), twosided=True)
    shut = scene([*room.meshes, chest], room.camera, [*room.materials, black], [hidden])
    samples = 4096 if run.full else 512
    image = run.render(shut, photons=20_000, spp=samples)
    without = run.render(replace(shut, lights=()), cells=1, photons=20_000, spp=64)
    run.check_share("direct light", mean(image, "direct"), mean(without, "direct"), 4 / np.sqrt(DARKEST * samples * 64))
    run.check_share("indirect light", mean(image, "indirect"), mean(without, "indirect"), 0.04)
    photons = image.metadata["report"]["photons"]
    run.check(
        "photons of the hidden lamp in the map", [x["stored"] for x in photons["lights"] if x["name"] == "hidden"], 0, 0
    )


# Long ways
