"""Section 3: rays and cameras in places where arithmetic is at its edge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from case import Run, hard_case
from numpy.typing import ArrayLike
from partitions import in_renderer, planes, with_tree
from rooms import ball, box, glowing_box, lit_room, quad, scene, view

from wdpm.cluster.render_settings import RenderSettings, Routing
from wdpm.images.image import Image
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes.model.bsdfs import Dielectric
from wdpm.scenes.model.lights import Environment
from wdpm.scenes.model.scene import Camera, Material, Scene, diffuse

SKY = Environment("sky", np.ones((1, 1, 3), np.float32))
FEW = RenderSettings(photons=1_000, spp=2, all_effects=True)

# Turns of a camera so that it looks along an axis; its matrix has zeros and, negated, -0.0.
AXES = {
    "+x": ((0, 0, 1), (0, 1, 0), (1, 0, 0)),
    "-x": ((0, 0, -1), (0, 1, 0), (-1, 0, 0)),
    "+y": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "-y": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "+z": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "-z": ((-1, 0, 0), (0, 1, 0), (0, 0, -1)),
}


SAME = "the image of one cell (symmetry)"
NONE = "none"


def _turned(axis: str, eye: ArrayLike, *, negative_zeros: bool = False) -> np.ndarray:
    to_world = np.eye(4)
    to_world[:3, :3] = np.array(AXES[axis], np.float64).T
    if negative_zeros:
        to_world[:3, :3][to_world[:3, :3] == 0] = -0.0
    to_world[:3, 3] = eye
    return to_world


@hard_case(
    "rays along axes",
    section=3,
    shows="zero components, and -0.0",
    expected="a closed box: every ray meets radiance 1",
    tolerance=NONE,
)
def along_axes(run: Run) -> None:
    """Parallel rays along each axis, with 0.0 and with -0.0, in a box whose planes some of them lie in."""
    for axis in AXES:
        for negative in (False, True):
            to_world = _turned(axis, (0.0, 0.0, 0.0), negative_zeros=negative)
            camera = Camera(to_world, 45.0, 8, 8, near_clip=1e-5, far_clip=10.0, orthographic=True)
            what = replace(glowing_box(albedo=(0.0, 0.0, 0.0)), camera=camera)
            image = run.render(what, photons=0, spp=4)
            sign = "-0.0" if negative else "0.0"
            depth = image.layers["depth"]
            along = np.sqrt(np.maximum(depth.astype(np.float64) ** 2 - 1.0, 0.0))  # across the axis, from the eye
            run.demand(f"all rays hit, {axis} with {sign}", bool((depth >= 1.0 - 1e-6).all() and (along < 1.5).all()))
            run.check(f"radiance, {axis} with {sign}", image.pixels, 1.0, 0)


@hard_case(
    "rays along split planes",
    section=3,
    shows="the eye where three planes meet",
    expected=SAME,
    tolerance="none: every bit",
)
def along_split_planes(run: Run) -> None:
    """The eye in the corner of eight cells, pixels' rays along their planes: the bits of one cell."""
    eye = (0.0, 0.0, 0.0)
    for axis in ("+z", "-x"):
        camera = Camera(_turned(axis, eye), 90.0, 9, 9, near_clip=1e-5, far_clip=10.0)
        what = replace(lit_room(), camera=camera)
        reference = run.render(what, settings=FEW, cells=1)
        for routing in Routing:
            with with_tree(*planes(what, [(0, 0.0), (1, 0.0), (2, 0.0)])):
                image = render_in_process(what, replace(FEW, routing=routing), workers=2, cells=8)
            run.demand(f"the same bits, {axis}, {routing.value}", image.digest() == reference.digest())


@hard_case(
    "rays through vertices and edges",
    section=3,
    shows="fields of view of 1e-6 degrees",
    expected="a wall without holes: 1",
    tolerance=NONE,
)
def through_vertices(run: Run) -> None:
    """Pixels are so small that every ray goes through one vertex where eight triangles meet, or an edge."""
    grid = np.linspace(-1.0, 1.0, 5)
    walls = [
        quad((x, y, 1.0), (0, grid[1] - grid[0], 0), (grid[1] - grid[0], 0, 0), emission=(1.0, 1.0, 1.0))
        for x in grid[:-1]
        for y in grid[:-1]
    ]
    black = [diffuse("black", (0.0, 0.0, 0.0))]
    for what, target in (
        ("a vertex", (0.0, 0.0, 1.0)),
        ("an edge", (0.25, 0.0, 1.0)),
        ("a diagonal", (0.25, 0.25, 1.0)),
    ):
        camera = view((0.0, 0.0, -1.0), target, 1e-6, 8, (0, 1, 0))
        image = run.render(scene(walls, camera, black), photons=0, spp=64 if run.full else 4)
        run.check(f"radiance through {what}", image.pixels, 1.0, 0)


@hard_case(
    "grazing rays",
    section=3,
    shows="1e-7 rad above a floor",
    expected="the floor, at a distance of 1",
    tolerance="1e-6, and what the direction's rounding (2^-24) does to a grazing distance",
)
def grazing(run: Run) -> None:
    """A camera 1e-7 above a floor that looks down by 1e-7 rad: it meets the floor at a distance of 1."""
    floor = quad((-4.0, 0.0, -4.0), (0, 0, 8.0), (8.0, 0, 0), emission=(1.0, 1.0, 1.0), name="floor")
    for angle in (1e-7, 1e-5, 1e-3):
        camera = view((0.0, angle, 0.0), (0.0, 0.0, 1.0), 1e-7, 4, (0, 1, 0))
        camera = replace(camera, near_clip=1e-9)
        image = run.render(scene([floor], camera, [diffuse("black", (0.0, 0.0, 0.0))]), photons=0, spp=2)
        run.check(f"radiance at {angle:g} rad", image.pixels, 1.0, 0)
        # The eye is known to half an ulp, 4e-15 of 1e-7; directions to 2^-24 of their length, 6e-8, along each axis.
        run.check(f"distance at {angle:g} rad", image.layers["depth"], 1.0, 1e-6 + 1.2e-7 / angle * 1e-2)


@hard_case(
    "rays that start in odd places",
    section=3,
    shows="on the lamp, a wall, an edge, a vertex",
    expected=SAME,
    tolerance="none: every bit",
)
def starting_in_odd_places(run: Run) -> None:
    """The eye on the lamp, on an edge of the room, in a vertex of it, on a wall, and on planes through it."""
    places = {
        "on the lamp": (0.05, 0.98, 0.1),
        "on a wall": (0.2, 0.3, -1.0),
        "on an edge": (-1.0, 0.2, -1.0),
        "in a vertex": (-1.0, -1.0, -1.0),
    }
    for name, eye in places.items():
        what = replace(lit_room(), camera=view(eye, (0.1, -0.2, 0.3), 60, 8))
        reference = run.render(what, settings=FEW, cells=1)
        with with_tree(*planes(what, [(a, float(eye[a])) for a in range(3)])):
            image = render_in_process(what, FEW, workers=2, cells=8)
        run.demand(f"the same bits, planes through an eye {name}", image.digest() == reference.digest())
        run.demand(f"rays hit, {name}", bool((reference.layers["depth"] > 0).mean() > 0.9))


@hard_case(
    "a camera inside a wall",
    section=3,
    shows="between faces 0.01 apart",
    expected="black: no light gets there",
    tolerance=NONE,
)
def inside_a_wall(run: Run) -> None:
    """The eye between the two faces of a wall 0.01 thick: it sees their backs, which are unlit, and nothing else."""
    wall = box((0.005, 1.0, 1.0), (0.6, 0, 0), name="wall")
    what = replace(lit_room(extra=[wall]), camera=view((0.601, 0.1, 0.1), (1.6, 0.3, 0.2), 40, 8))
    # Photons on the other side of the far face lie 0.01 off the plane, which counts 8 times (constants.FLATTENING).
    image = run.render(what, settings=replace(FEW, radius=0.05))
    run.check("brightest pixel", image.pixels.max(), 0, 0)
    run.demand("every ray hits", bool((image.layers["depth"] > 0).all()))


@hard_case(
    "a camera inside glass",
    section=3,
    shows="in the middle of a ball under a sky of 1",
    expected="eta² = 2.25, by conservation of radiance / eta²",
    tolerance="1 %: noise of reflections inside, and the ball's facets",
)
def inside_glass(run: Run) -> None:
    """The eye in the middle of a glass ball under a sky of 1: radiance in glass is eta² times that outside."""
    what = scene(
        [ball(1.0, around=96)],
        view((0.0, 0.0, 0.0), (0.3, 0.2, 1.0), 40, 16 if run.full else 8),
        [Material("glass", Dielectric(1.5))],
        [SKY],
    )
    image = run.render(what, photons=0, caustic_photons=0, spp=256 if run.full else 64)
    run.check_share("radiance", image.pixels.mean(axis=(0, 1)), 1.5**2, 0.01)


@hard_case(
    "fields of view of 0.01 and 179 degrees",
    section=3,
    shows="a closed box that glows",
    expected="radiance 1; distances by intersection in double",
    tolerance="none in radiance; distances 1e-5, and 1e-3 of a pixel's own range",
)
def narrow_and_wide(run: Run) -> None:
    """Fields of view of 0.01 and 179 degrees in a closed box that glows: no ray is lost, and distances are right."""
    for fov in (0.01, 179.0):
        eye = np.array([0.2, 0.1, -0.3])
        what = replace(glowing_box(albedo=(0.0, 0.0, 0.0)), camera=_straight(eye, fov, 16 if run.full else 8))
        image = run.render(what, photons=0, spp=4)
        run.check(f"radiance at {fov:g} degrees", image.pixels, 1.0, 0)
        if fov < 1:
            run.check("distance at 0.01 degrees", image.layers["depth"], 1.3, 1e-5)
        else:
            _between(run, image, eye, fov)


def _straight(eye: ArrayLike, fov: float, size: int) -> Camera:
    to_world = np.eye(4)
    to_world[:3, 3] = eye
    return Camera(to_world, fov, size, size, near_clip=1e-6, far_clip=1e3)


def _between(run: Run, image: Image, eye: np.ndarray, fov: float) -> None:
    """Mean distances of pixels lie between the least and largest of a fine grid of rays through each, in double."""
    size, fine = image.layers["depth"].shape[0], 33
    place = (np.arange(size * fine) + 0.5) / (size * fine) * 2 - 1
    half = np.tan(np.radians(fov) / 2)
    # The camera's +x is to the left of the image and +y is up; rows go down.
    x, y = np.meshgrid(-place * half, -place * half)
    direction = np.stack([x, y, np.ones_like(x)], axis=-1)
    with np.errstate(divide="ignore"):
        t = np.min((np.sign(direction) - eye) / direction, axis=-1, initial=np.inf)
    distance = t * np.linalg.norm(direction, axis=-1)
    blocks = distance.reshape(size, fine, size, fine)
    least, most = blocks.min(axis=(1, 3)), blocks.max(axis=(1, 3))
    depth = image.layers["depth"].astype(np.float64)
    inside = (depth >= least * (1 - 1e-3)) & (depth <= most * (1 + 1e-3))
    run.demand(
        f"distances at {fov:g} degrees",
        bool(inside.all()),
        f"{(~inside).sum()} pixels off",
        "within each pixel's range",
    )


@hard_case(
    "planes beside the eye",
    section=3,
    shows="split planes at the eye, one float less, one more",
    expected=SAME,
    tolerance="none: every bit",
)
def planes_in_float_neighbours(run: Run) -> None:
    """Planes at the eye's own floats and the next ones: the bits of one cell."""
    what: Scene = lit_room()
    eye = what.camera.to_world[:3, 3]
    at = in_renderer(what, eye)
    reference = run.render(what, settings=FEW, cells=1)
    for name, towards in (("below", -np.inf), ("at", None), ("above", np.inf)):
        x, y = (float(v if towards is None else np.nextafter(v, np.float32(towards))) for v in at[:2])
        with with_tree([0, 1, 1], [x, y, y]):
            image = render_in_process(what, FEW, workers=2, cells=4)
        run.demand(f"the same bits, planes one float {name}", image.digest() == reference.digest())
