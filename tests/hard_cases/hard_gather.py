"""Section 5: final gathering and the irradiance cache at their limits.

Each image is compared in one cell and in four, so every case here asks for equal bits too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from unittest.mock import patch

import numpy as np
from case import HardCase, Run
from numpy.typing import NDArray
from placing import moved, on_lattice, scaled
from rooms import GREY, ball, box, glowing_box, lit_room, quad, scene, view

from wdpm.cluster.plan import view as view_plan
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings
from wdpm.images.image import Image
from wdpm.scenes.meshes.mesh_data import MeshData
from wdpm.scenes.meshes.primitives import sphere
from wdpm.scenes.model.bsdfs import BumpMap, Conductor, Dielectric, Diffuse, TwoSided
from wdpm.scenes.model.lights import Environment
from wdpm.scenes.model.scene import Material, Mesh, Scene, diffuse
from wdpm.scenes.model.textures import Bitmap

Array = NDArray[np.float64]
WAYS = (Indirect.GATHER, Indirect.CACHE)
SKY = Environment("sky", np.ones((1, 1, 3), np.float32))


THIN_FLOOR = (
    "photons of a parallel floor count as eight times as far away as they are, and these are nearer: as with the map, "
    "no further than the gather radius, and gone with it; --integrator path has no such bias"
)


def chosen(run: Run, way: Indirect, **others: object) -> RenderSettings:
    """Settings of these cases."""
    size = {"photons": 60_000, "spp": 64} if run.full else {"photons": 8_000, "spp": 8}
    return RenderSettings(**{"all_effects": True, "indirect": way, "caustic_photons": 4_000, **size, **others})


def gathered(run: Run, what: Scene, way: Indirect, **others: object) -> Image:
    return run.render(what, settings=chosen(run, way, **others))


def traced(run: Run, what: Scene) -> Image:
    """The same light by path tracing."""
    settings = RenderSettings(integrator=Integrator.PATH, spp=1024 if run.full else 128, all_effects=True)
    return run.render(what, settings=settings, cells=1)


def indirect(image: Image) -> Array:
    """Mean of all light but what lamps send straight to what is seen, by channel."""
    layers = [image.layers[name] for name in ("indirect", "caustic") if name in image.layers]
    return np.asarray(sum(layer.mean(axis=(0, 1), dtype=np.float64) for layer in layers))


def quarter_of_it(run: Run, image: Image, share: float) -> None:
    """In a furnace of albedo 1/2 a quarter of the light is indirect."""
    run.check_share("indirect light", indirect(image), 0.5, share)


def furnace_with(things: list[Mesh], *materials: Material, size: int = 8) -> Scene:
    """The glowing box of albedo 1/2, and things in it."""
    what = glowing_box(size=size)
    return replace(what, meshes=(*what.meshes, *things), materials=(*what.materials, *materials))


# Walls


def a_dark_box(run: Run, way: Indirect) -> None:
    """A closed box without thickness in a lit room: no ray and no photon has any business in it."""
    for half in (0.3, 0.01):
        shell = box((half, half, half), (0.0, -0.2, 0.1), name="shell")
        inside = view((0.0, -0.2, 0.1 - 0.9 * half), (0.0, -0.2 - 0.3 * half, 0.1), 80, 8)
        image = gathered(run, replace(lit_room(extra=[shell]), camera=inside), way)
        run.check(f"light in a box of {2 * half:g}", image.pixels, 0.0, 0.0)


def under_the_floor(run: Run, way: Indirect, depth: float) -> None:
    """A closed cellar as low as this below a lit floor; its own floor faces the same way, its walls lie further in."""
    room = lit_room()
    cellar = box((0.8, depth / 2, 0.8), (0.0, -1.0 - depth / 2, 0.0), inside=True, name="cellar")
    eye = (0.3, -1.0 - depth / 2, -0.6)
    camera = view(eye, (0.2, -1.0 - 0.9 * depth, -0.6 + 2 * depth), 60, 8)
    image = gathered(run, replace(room, meshes=(*room.meshes, cellar), camera=camera), way)
    run.check(f"light in a cellar of {depth:g}", image.pixels, 0.0, 0.0)


# Shapes


def a_crumb_on_a_floor(run: Run, way: Indirect) -> None:
    """A cube of a thousandth of the floor's length, from nearby: its shadow's edge is lit by it alone."""
    floor = quad((-10, 0, -10), (0, 0, 20), (20, 0, 0))
    crumb = box((0.01, 0.01, 0.01), (0.0, 0.01, 0.0), 1)
    look = view((0.05, 0.05, -0.06), (0.0, 0.005, 0.0), 35, 16)
    red = diffuse("red", (0.8, 0.1, 0.1), twosided=True)
    what = scene([floor, crumb], look, [diffuse("grey", GREY, twosided=True), red], [SKY])
    image = gathered(run, what, way)
    run.check_share("indirect light", indirect(image), indirect(traced(run, what)), 0.04 if run.full else 0.12)


def bumpy(around: int) -> MeshData:
    """A ball whose vertices are pushed in and out at random, with normals that blend between its triangles."""
    data = sphere(around)
    place, number = np.unique(np.round(data.vertices, 9), axis=0, return_inverse=True)
    out = 1.0 + np.random.default_rng(1).uniform(-0.05, 0.05, len(place))
    return replace(data, vertices=(place * out[:, None])[number.reshape(-1)])


def strong_normals(run: Run, way: Indirect) -> None:
    """Normals that turn by tens of degrees a triangle, in a furnace: the ball is not seen."""
    slopes = Bitmap("slopes", np.random.default_rng(2).random((8, 8, 3)).astype(np.float32))
    cases = {
        "smooth, of few triangles": (sphere(12), Diffuse(GREY), 0.06 if run.full else 0.15),
        "bumpy mesh": (bumpy(24), Diffuse(GREY), 0.06 if run.full else 0.15),
        "bump map": (sphere(24), BumpMap(Diffuse(GREY), slopes, 0.1), 0.06 if run.full else 0.15),
    }
    for name, (data, bsdf, share) in cases.items():
        mesh = Mesh("ball", data.vertices * 0.5, data.faces, data.normals, data.uvs, 1, emission=(1.0, 1.0, 1.0))
        look = view((0, 0, -0.95), (0, 0, 0), 60, 16)
        what = replace(furnace_with([mesh], Material(name, bsdf)), camera=look)
        image = gathered(run, what, way)
        expected = traced(run, what)
        run.check_share(f"indirect light, {name}", indirect(image), indirect(expected), share)
        dark = (image.layers["indirect"].min(axis=2) < 0.1 * image.layers["indirect"].mean()).mean()
        run.check(f"share of black pixels, {name}", dark, 0.0, 0.02)


def open_to_all_sides(run: Run, way: Indirect) -> None:
    """Two small plates under the sky: nearly no ray hits, nearly no photon lands."""
    plates = [quad((-0.1, 0, -0.1), (0, 0, 0.2), (0.2, 0, 0)), quad((0.1, 0, -0.1), (0, 0, 0.2), (0.05, 0.1, 0))]
    what = scene(plates, view((0.0, 0.5, -0.5), (0.05, 0, 0), 40, 12), lights=[SKY])
    image = gathered(run, what, way)
    run.check_share("indirect light", indirect(image), indirect(traced(run, what)), 0.15 if run.full else 0.6)


# Few of everything


def one_record(run: Run) -> None:
    """A plan with one candidate: all that it does not reach gathers for itself."""
    few = replace(view_plan.CACHE_PLAN, rounds=1, spacing=1 << 14)
    with patch.object(view_plan, "CACHE_PLAN", few):
        image = gathered(run, glowing_box(size=12), Indirect.CACHE)
    quarter_of_it(run, image, 0.05)
    other = gathered(run, glowing_box(size=12), Indirect.GATHER)
    same = np.all(image.layers["indirect"] == other.layers["indirect"], axis=2)
    run.demand("some pixels gather for themselves", bool(same.any()))
    run.demand("some are near the record", bool((~same).any()))


def few_strata(run: Run) -> None:
    """Records of as few rays as there may be."""
    with patch.object(view_plan, "CACHE_PLAN", replace(view_plan.CACHE_PLAN, rows=1, columns=3)):
        quarter_of_it(run, gathered(run, glowing_box(), Indirect.CACHE), 0.06)


def few_photons(run: Run, way: Indirect) -> None:
    """None: no indirect light, as with the map. One: what finds it is too bright, and rays that do not go on."""
    image = gathered(run, glowing_box(), way, photons=0)
    run.check("indirect light without photons", image.layers["indirect"], 0.0, 0.0)
    gathered(run, glowing_box(), way, photons=1, k=1)
    gathered(run, lit_room(), way, photons=3, k=500)


def left_out(run: Run, way: Indirect) -> None:
    """--without indirect leaves all of it out, however it would be found."""
    image = gathered(run, lit_room(), way, without=("indirect",))
    run.check("indirect light", image.layers["indirect"], 0.0, 0.0)


# Cameras


def inside_glass(run: Run, way: Indirect) -> None:
    """The camera in the middle of a glass ball in a furnace: what it sees was refracted into it."""
    glass = ball(0.5, (0.2, 0.1, -0.3), 1, around=48)
    what = furnace_with([glass], Material("glass", Dielectric(1.5)))
    image = gathered(run, what, way)
    run.check_share("radiance", image.pixels.mean(dtype=np.float64), traced(run, what).pixels.mean(), 0.05)


def only_rough_metal(run: Run) -> None:
    """No place for a record is seen: every pixel gathers for itself, with the bits of the gather."""
    metal = quad((-0.9, -0.9, 0.5), (0, 1.8, 0), (1.8, 0, 0), 1)
    what = replace(
        lit_room(extra=[metal], materials=[Material("metal", TwoSided(Conductor(alpha_u=0.1, alpha_v=0.1)))]),
        camera=view((0, 0, 0), (0, 0, 1), 60, 8),
    )
    one, other = (gathered(run, what, way) for way in WAYS)
    run.demand("there is indirect light", bool(one.layers["indirect"].any()))
    run.demand("the same bits as by gathering", one.digest() == other.digest())


def tiny_pictures(run: Run, way: Indirect) -> None:
    """One pixel, one row, and a part of a larger picture."""
    what = lit_room()
    for width, height in ((1, 1), (17, 1), (1, 9)):
        camera = replace(what.camera, width=width, height=height)
        image = gathered(run, replace(what, camera=camera), way)
        run.demand(f"{width} x {height} pixels have light", bool(image.layers["indirect"].any()))
    whole = replace(what, camera=replace(what.camera, width=20, height=20))
    part = replace(whole, camera=replace(whole.camera, crop=(6, 4, 9, 7), full_size=(20, 20), width=9, height=7))
    expected = gathered(run, whole, way).layers["indirect"][4:11, 6:15]
    cropped = gathered(run, part, way).layers["indirect"]
    if way is Indirect.GATHER:
        run.demand("a crop has the bits of the whole", np.array_equal(cropped, expected))
    run.check_share("indirect light of a crop", cropped.mean(), expected.mean(), 0.05)


# Units


def in_any_unit(run: Run, way: Indirect) -> None:
    """Records and what they reach follow the scene's unit and place."""
    what = on_lattice(lit_room(size=12))
    expected = gathered(run, what, way)
    for by in (2.0**-20, 2.0**20):
        image = run.render(scaled(what, by), settings=chosen(run, way), cells=1)
        same = all(np.array_equal(image.layers[name], expected.layers[name]) for name in ("beauty", "indirect"))
        run.demand(f"the same bits, times {by:g}", same)
    image = run.render(moved(what, (2.0**20, -(2.0**18), 2.0**19)), settings=chosen(run, way), cells=1)
    run.demand("the same bits, a million sizes away", image.digest() == expected.digest())


NAMES = {Indirect.GATHER: "final gather", Indirect.CACHE: "irradiance cache"}


def _of_scenes(way: Indirect) -> Iterator[HardCase]:
    name = NAMES[way]
    yield HardCase(
        name=f"{name}: a dark box in a lit room",
        section=5,
        shows="walls without thickness, lit from outside, the camera inside",
        expected="no light: 0",
        tolerance="none",
        measure=partial(a_dark_box, way=way),
    )
    for depth in (0.2, 0.005):
        yield HardCase(
            name=f"{name}: a cellar {depth:g} deep",
            section=5,
            shows="a dark floor closely below a lit one that faces the same way",
            expected="no light: 0",
            tolerance="none",
            measure=partial(under_the_floor, way=way, depth=depth),
            limit=THIN_FLOOR if depth < 0.1 else "",
        )
    yield HardCase(
        name=f"{name}: a crumb on a large floor",
        section=5,
        shows="a red cube of a thousandth of the floor's length, seen from nearby",
        expected="path tracing",
        tolerance="4 % (small: 12 %): noise of both",
        measure=partial(a_crumb_on_a_floor, way=way),
    )
    yield HardCase(
        name=f"{name}: strong normals",
        section=5,
        shows="balls of few smooth triangles, of bumps, with a bump map, in a furnace",
        expected="path tracing; no holes",
        tolerance="6 % (small: 15 %): noise, and interpolation between normals that turn fast",
        measure=partial(strong_normals, way=way),
    )
    yield HardCase(
        name=f"{name}: open to all sides",
        section=5,
        shows="two plates under the sky: few hits, few photons",
        expected="path tracing",
        tolerance="15 % (small: 60 %): noise of few photons",
        measure=partial(open_to_all_sides, way=way),
    )


def _of_settings(way: Indirect) -> Iterator[HardCase]:
    name = NAMES[way]
    yield HardCase(
        name=f"{name}: no photons, one, and three",
        section=5,
        shows="gather rays that find nothing to read",
        expected="without photons no indirect light; with few, finite light and the same bits in any partition",
        tolerance="none",
        measure=partial(few_photons, way=way),
    )
    yield HardCase(
        name=f"{name}: left out",
        section=5,
        shows="--without indirect",
        expected="no indirect light: 0",
        tolerance="none",
        measure=partial(left_out, way=way),
    )
    yield HardCase(
        name=f"{name}: a camera inside glass",
        section=5,
        shows="everything is seen through a refracting surface",
        expected="path tracing of the same furnace",
        tolerance="5 %: noise",
        measure=partial(inside_glass, way=way),
    )
    yield HardCase(
        name=f"{name}: one pixel, one row, a crop",
        section=5,
        shows="pictures smaller than the grid of candidates",
        expected="light; a crop is a part of the whole picture",
        tolerance="none for gathering; records of a crop are others: 5 %",
        measure=partial(tiny_pictures, way=way),
    )
    yield HardCase(
        name=f"{name}: in any unit and place",
        section=5,
        shows="the room times 2^-20 and 2^20, and a million sizes away",
        expected="the same image (symmetry)",
        tolerance="none",
        measure=partial(in_any_unit, way=way),
    )


def _of_few_records() -> Iterator[HardCase]:
    yield HardCase(
        name="irradiance cache: one record",
        section=5,
        shows="a plan with one candidate, and all else gathered",
        expected="a furnace",
        tolerance="5 %: noise",
        measure=one_record,
    )
    yield HardCase(
        name="irradiance cache: records of three rays",
        section=5,
        shows="one row of three strata",
        expected="a furnace",
        tolerance="6 %: noise of photons",
        measure=few_strata,
    )
    yield HardCase(
        name="irradiance cache: only rough metal in view",
        section=5,
        shows="no place for a record is seen",
        expected="the bits of final gathering",
        tolerance="none",
        measure=only_rough_metal,
    )


CASES = (
    *(case for way in WAYS for cases in (_of_scenes, _of_settings) for case in cases(way)),
    *_of_few_records(),
)
