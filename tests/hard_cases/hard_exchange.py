"""Section 8, of light between surfaces: form factors and radiosity."""

from __future__ import annotations

from dataclasses import replace
from math import cos, pi, radians, sin

import numpy as np
from beams import parallel
from case import Run, hard_case
from numpy.typing import NDArray
from optics import disk_irradiance, sphere_irradiance
from polygon_light import polygon_irradiance
from rooms import GREY, ball, quad, scene, view

from wdpm.scenes.meshes.primitives import disk, sphere
from wdpm.scenes.model.scene import Mesh, diffuse

Array = NDArray[np.float64]
UP = np.array([0.0, 1.0, 0.0])
FLOOR = quad((-50, 0, -50), (0, 0, 100), (100, 0, 0), name="floor")
WHITE = (1.0, 1.0, 1.0)


def mean(pixels: NDArray[np.float32]) -> Array:
    return np.asarray(pixels.mean(axis=(0, 1), dtype=np.float64))


def at_origin(lamp: Mesh, run: Run) -> float:
    """Irradiance that a lamp of radiance 1 brings to the floor about the origin, over pi."""
    what = scene([FLOOR, lamp], view((0.3, 1.0, -4.0), (0, 0, 0), 0.01), [diffuse("floor", GREY)])
    seen = [
        float(
            run.render(what, cells=4 if seed == 0 else 1, seed=seed, photons=0, spp=4096 if run.full else 1024)
            .layers["direct"]
            .mean(dtype=np.float64)
        )
        for seed in range(4 if run.full else 1)
    ]
    return float(np.mean(seen)) / 0.5


@hard_case(
    "form factors of rectangles",
    section=8,
    shows="direct light of rectangular lamps, near and far, parallel, perpendicular and slanted",
    expected="Lambert's polygon formula",
    tolerance="0.1 %: 65,536 stratified samples, whose integrand varies by less than 100 %",
)
def rectangles(run: Run) -> None:
    for name, corner, u, v in (
        ("parallel", (-1, 2, -1), (2, 0, 0), (0, 0, 2)),
        ("aside", (1, 1.5, 0.5), (1, 0, 0), (0, 0, 1.5)),
        ("perpendicular", (-1.5, 0.2, -1), (0, 0, 2), (0, 1.5, 0)),
        ("slanted", (-1, 1.5, -1), (2, 1, 0), (0, 0, 2)),
    ):
        a, du, dv = (np.array(x, float) for x in (corner, u, v))
        lamp = quad(a, du, dv, 0, WHITE)
        if np.cross(du, dv) @ -a < 0:
            lamp = quad(a, dv, du, 0, WHITE)
        exact = polygon_irradiance(np.array([a, a + du, a + du + dv, a + dv]), np.zeros(3), UP)
        run.check_share(f"rectangle, {name}", at_origin(lamp, run) * pi, exact, 1e-3)


@hard_case(
    "form factors of spheres",
    section=8,
    shows="direct light of spherical lamps, of which half faces away",
    expected="pi (r / d)² cos a",
    tolerance="0.1 %: noise; 128 segments around, of the right area, are off by 2e-4",
)
def spheres(run: Run) -> None:
    for radius, distance, angle in ((0.5, 2.0, 0.0), (1.0, 1.5, 0.0), (0.3, 1.0, 60.0)):
        a = radians(angle)
        middle = distance * np.array([sin(a), cos(a), 0.0])
        data = sphere(128, true_area=True)
        lamp = Mesh("lamp", data.vertices * radius + middle, data.faces, data.normals, None, 0, WHITE)
        exact = sphere_irradiance(radius, distance, cos(a))
        run.check_share(f"sphere of {radius} at {distance}, {angle:g} degrees", at_origin(lamp, run) * pi, exact, 1e-3)


@hard_case(
    "form factors of disks",
    section=8,
    shows="direct light of disks, on and off their axis",
    expected="Foote's formula",
    tolerance="0.1 %: noise; 256 segments around",
)
def disks(run: Run) -> None:
    for radius, height, aside in ((1.0, 2.0, 0.0), (0.5, 1.0, 0.8), (2.0, 1.0, 1.0)):
        data = disk(256, true_area=True)
        vertices = data.vertices[:, [0, 2, 1]] * radius + (aside, height, 0.0)  # faces -y
        lamp = Mesh("lamp", vertices, data.faces, None, None, 0, WHITE)
        run.check_share(
            f"disk of {radius} at {height}, {aside} aside",
            at_origin(lamp, run) * pi,
            disk_irradiance(radius, height, aside),
            1e-3,
        )


# Radiosity


@hard_case(
    "exchange of two balls",
    section=8,
    shows="a glowing grey ball in a grey hollow one",
    expected="two linear equations: the inner one sees the outer alone",
    tolerance="1 %, at the small size 4 %: noise of photons and light samples",
)
def concentric(run: Run) -> None:
    inner, outer = 0.5, 1.0
    rho = {"inner": 0.3, "outer": 0.7}
    share = (inner / outer) ** 2
    # B1 = E + rho1 B2, B2 = rho2 (share B1 + (1 - share) B2): the inner one sees the outer alone.
    matrix = np.array([[1.0, -rho["inner"]], [-rho["outer"] * share, 1.0 - rho["outer"] * (1.0 - share)]])
    exact = np.linalg.solve(matrix, [1.0, 0.0])
    shell = sphere(96, true_area=True)
    meshes = [
        replace(ball(inner, around=96), emission=WHITE),
        Mesh("shell", shell.vertices * outer, shell.faces[:, ::-1], -shell.normals, None, 1),
    ]
    materials = [diffuse(name, (rho[name],) * 3) for name in ("inner", "outer")]
    photons = 1_600_000 if run.full else 400_000
    for name, target, value in (("inner", (0, 0, 0), exact[0]), ("outer", (0, 0, -1), exact[1])):
        camera = view((0.1, 0.05, -0.75), target, 50, 8)
        seen = run.render(scene(meshes, camera, materials), photons=photons, k=400, spp=1024 if run.full else 64)
        run.check_share(f"the {name} one", mean(seen.pixels), np.full(3, value), 0.01 if run.full else 0.04)


GAP = 0.25
"""Between the boxes; light that goes out there is gone."""


def walls() -> list[tuple[Array, Array, Array, int]]:
    """Corner and edges of the ten walls, facing inwards, and the box that they belong to.

    Two unit cubes in one line along z, open where they face each other: a straight line between two of their points
    does not leave the tube that both are parts of, so nothing hides anything.
    """
    x, y, z = np.eye(3)
    found = []
    for number, start in enumerate((0.0, 1.0 + GAP)):
        o = start * z
        found += [
            (o, z, x, number),  # y = 0, faces y
            (o + y, x, z, number),  # y = 1
            (o, y, z, number),  # x = 0, faces x
            (o + x, z, y, number),  # x = 1
            (o, x, y, number) if number == 0 else (o + z, y, x, number),  # the back
        ]
    return found


LAMP = 4
"""The first box's back glows."""

ALBEDOS = (0.5, 0.8)


def radiosity(patches: int) -> tuple[Array, Array]:
    """Radiance of each wall, after one reflection and after more: collocation, analytic form factors. Shape [walls]."""
    corner, middle, normal, albedo, glow = [], [], [], [], []
    step = np.arange(patches) / patches
    for number, (o, u, v, of_box) in enumerate(walls()):
        for s in step:
            for t in step:
                a, du, dv = o + s * u + t * v, u / patches, v / patches
                corner.append([a, a + du, a + du + dv, a + dv])
                middle.append(a + du / 2 + dv / 2)
                normal.append(np.cross(u, v))
                albedo.append(ALBEDOS[of_box])
                glow.append(1.0 if number == LAMP else 0.0)
    corners, normals, rho = np.array(corner), np.array(normal), np.array(albedo)
    factors = np.stack([_seen_from(corners, p, n) for p, n in zip(np.array(middle), normals, strict=True)])
    light = np.linalg.solve(np.eye(len(rho)) - rho[:, None] * factors, np.array(glow))
    once = rho * (factors @ np.array(glow))
    often = light - np.array(glow) - once
    return once.reshape(len(walls()), -1).mean(axis=1), often.reshape(len(walls()), -1).mean(axis=1)


def _seen_from(corners: Array, point: Array, normal: Array) -> Array:
    """Form factors of a point to polygons above its horizon (Lambert 1760), shape [N]."""
    arms = corners - point
    arms = arms / np.linalg.norm(arms, axis=2, keepdims=True)
    following = np.roll(arms, -1, axis=1)
    across = np.cross(arms, following)
    length = np.linalg.norm(across, axis=2)
    angle = np.arctan2(length, (arms * following).sum(axis=2))
    edges = np.divide(angle * (across @ normal), length, out=np.zeros_like(angle), where=length > 1e-12)
    apart = np.abs((corners - point) @ normal).max(axis=1) > 1e-9  # its own plane is not seen
    return np.asarray(np.where(apart, np.abs(edges.sum(axis=1)) / (2 * pi), 0.0))


@hard_case(
    "exchange of two boxes",
    section=8,
    shows="two open boxes, mouth to mouth at a distance, one of which glows",
    expected="radiosity of 4,000 patches with analytic form factors, at the small size 1,000",
    tolerance="1 %, at the small size 4 %: noise of photons; patches are worth 0.1 %",
)
def two_boxes(run: Run) -> None:
    once, often = radiosity(20 if run.full else 10)
    meshes = [quad(o, u, v, box, WHITE if number == LAMP else None) for number, (o, u, v, box) in enumerate(walls())]
    materials = [diffuse(f"box {number}", (albedo,) * 3) for number, albedo in enumerate(ALBEDOS)]
    for name, number in (
        ("the lamp's wall", LAMP),
        ("the first floor", 0),
        ("the second floor", 5),
        ("the second back", 9),
    ):
        o, u, v, _ = walls()[number]
        inwards = np.cross(u, v)
        middle = o + u / 2 + v / 2
        camera = parallel(middle + 0.5 * inwards, middle, 0.5, 16 if run.full else 8, up=u)
        image = run.render(
            scene(meshes, camera, materials),
            cells=4 if number == 0 else 1,
            photons=1_000_000 if run.full else 100_000,
            k=200 if run.full else 100,
            spp=64,
        )
        share = 0.01 if run.full else 0.04
        run.check_share(f"{name}, indirect", mean(image.layers["indirect"]), np.full(3, often[number]), share)
        if number > LAMP:  # on walls that meet the lamp the variance of single light samples is infinite
            run.check_share(f"{name}, direct", mean(image.layers["direct"]), np.full(3, once[number]), share)
