"""Lights by themselves: tables of a few lights, and kernels that only sample them."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.features import ALL, Features
from wdpm.kernels.lights import lights
from wdpm.kernels.lights.lights import Lights, Targets, make_lights
from wdpm.kernels.materials import texture
from wdpm.kernels.materials.texture import Textures
from wdpm.scenes.flat.arrays import Triangles
from wdpm.scenes.flat.light_table import LightTable, tabulate_lights
from wdpm.scenes.model.lights import DirectionalLight, Environment, Light, PointLight, ProjectorLight, SpotLight
from wdpm.scenes.model.scene import Mesh
from wdpm.scenes.model.textures import RGB, Texture
from wdpm.scenes.model.transforms import look_at

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Array = NDArray[np.float64]
Rows = NDArray[np.float32]

QUAD = np.array([[[-1, -1, 0], [1, -1, 0], [1, 1, 0]], [[-1, -1, 0], [1, 1, 0], [-1, 1, 0]]], np.float32)
"""The square from -1 to 1 in the plane z = 0, its front up; shape [2, 3, 3]."""
QUAD_UVS = (QUAD[..., :2] + 1) / 2


@dataclass(frozen=True)
class Glow:
    """A glowing mesh of triangles."""

    corners: Rows
    radiance: RGB | Texture
    uvs: Rows | None = None


def square(height: float, side: float, radiance: RGB | Texture = (1.0, 1.0, 1.0), *, down: bool = True) -> Glow:
    """A glowing square across the z axis, its front down or up."""
    corners = (QUAD * (side / 2) + np.array([0, 0, height])).astype(np.float32)
    order = [0, 2, 1] if down else [0, 1, 2]
    return Glow(corners[:, order], radiance, QUAD_UVS[:, order])


def table_of(
    glows: Sequence[Glow] = (), others: Sequence[Light] = (), textures: Sequence[Texture] = (), radius: float = 10.0
) -> LightTable:
    """The table of a scene with these lights and one dark triangle, out of the way, that makes its sphere's radius."""
    dark = np.array([[[0, 0, -radius], [0, 0.1, -radius], [0.1, 0, -radius]]], np.float32)
    corners = np.concatenate([dark, *(glow.corners for glow in glows)])
    uvs = [np.zeros((len(g.corners), 3, 2), np.float32) if g.uvs is None else g.uvs for g in glows]
    count = len(corners)
    triangles = Triangles(
        ids=np.arange(count, dtype=np.int32),
        positions=corners,
        normals=np.zeros((count, 3, 3), np.float32),
        uvs=np.concatenate([np.zeros((1, 3, 2), np.float32), *uvs]),
        material=np.zeros(count, np.int32),
        emitter=np.repeat(np.arange(-1, len(glows)), [1, *(len(g.corners) for g in glows)]).astype(np.int32),
        colors=np.zeros((0, 3, 3), np.float32),
        area_before=np.zeros(count),
    )
    meshes = [
        Mesh(f"mesh {i}", np.zeros((0, 3)), np.zeros((0, 3), np.int64), None, None, 0, emission=glow.radiance)
        for i, glow in enumerate(glows)
    ]
    numbers = [next((n for n, t in enumerate(textures) if t is glow.radiance), -1) for glow in glows]
    return tabulate_lights(meshes, triangles, np.array(numbers, np.int32), textures, others)


@functools.cache
def _direct_kernel(features: Features) -> wp.Kernel:
    light = make_lights(features)
    sample_direct = light.sample_direct
    environment_from = light.environment_from
    environment_radiance = light.environment_radiance
    pdf_triangle = light.pdf_triangle

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def kernel(
        lights: Lights,
        textures: Textures,
        place: wp.array[wp.vec3],
        point: wp.array[wp.vec2d],
        direction_out: wp.array[wp.vec3],
        end_out: wp.array[wp.vec3],
        radiance_out: wp.array[wp.vec3],
        pdf_out: wp.array[wp.float32],
        delta_out: wp.array[wp.int32],
        light_out: wp.array[wp.int32],
        environment_out: wp.array[wp.vec3],
        environment_pdf_out: wp.array[wp.float32],
        triangle_pdf_out: wp.array[wp.float32],
    ):
        i = wp.tid()
        s = sample_direct(lights, textures, place[i], point[i])
        direction_out[i] = s.direction
        end_out[i] = s.end
        radiance_out[i] = s.radiance
        pdf_out[i] = s.pdf
        delta_out[i] = s.delta
        light_out[i] = s.light
        environment_out[i] = environment_radiance(lights, s.direction)
        environment_pdf_out[i] = environment_from(lights, place[i], s.direction).pdf
        # The pdf of the first glowing triangle, as if the end lay on it.
        triangle_pdf_out[i] = 0.0
        if lights.triangles > 0:
            triangle_pdf_out[i] = pdf_triangle(
                lights, lights.emitter[0], lights.prim[0], place[i], s.end, lights.normal[0]
            )

    return kernel


@functools.cache
def _emission_kernel(features: Features) -> wp.Kernel:
    emit = make_lights(features).emit

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def kernel(
        lights: Lights,
        textures: Textures,
        cumulative: wp.array[wp.float64],
        targets: Targets,
        aimed: wp.int32,
        u_element: wp.array[wp.float64],
        u_position: wp.array[wp.vec2],
        u_direction: wp.array[wp.vec2],
        u_target: wp.array[wp.float32],
        light_out: wp.array[wp.int32],
        element_out: wp.array[wp.int32],
        origin_out: wp.array[wp.vec3],
        direction_out: wp.array[wp.vec3],
        flux_out: wp.array[wp.vec3],
        medium_out: wp.array[wp.int32],
    ):
        i = wp.tid()
        e = emit(lights, textures, cumulative, targets, aimed, u_element[i], u_position[i], u_direction[i], u_target[i])
        light_out[i] = e.light
        element_out[i] = e.element
        origin_out[i] = e.origin
        direction_out[i] = e.direction
        flux_out[i] = e.flux
        medium_out[i] = e.medium

    return kernel


@dataclass(frozen=True)
class Ways:
    """What sample_direct found, one a row, and what the other functions say of its directions."""

    direction: Array
    end: Array
    radiance: Array
    pdf: Array
    delta: Array
    light: Array
    environment: Array
    environment_pdf: Array
    triangle_pdf: Array


@dataclass(frozen=True)
class Photons:
    """What emit sent, one a row."""

    light: Array
    element: Array
    origin: Array
    direction: Array
    flux: Array
    medium: Array


def numbers(count: int, seed: int, columns: int = 2) -> Rows:
    """Numbers in [0, 1), multiples of 2^-24, as kernels draw them."""
    return (np.random.default_rng(seed).integers(0, 1 << 24, (count, columns)) * 2.0**-24).astype(np.float32)


def direct(
    table: LightTable,
    place: Sequence[float] | Array,
    count: int,
    textures: Sequence[Texture] = (),
    seed: int = 0,
    features: Features = ALL,
    points: Array | None = None,
) -> Ways:
    """Ways from a place (or places) to the lights.

    Args:
        points: of the unit square, float64, shape [count, 2], that choose them; None for random ones.
    """
    places = np.broadcast_to(np.asarray(place, np.float32), (count, 3))
    across = np.random.default_rng(seed).permutation(count) + 0.5
    point = points
    if point is None:
        point = np.stack([across / count, numbers(count, seed + 1, 1)[:, 0]], axis=1)
    types = [wp.vec3, wp.vec3, wp.vec3, wp.float32, wp.int32, wp.int32, wp.vec3, wp.float32, wp.float32]
    outputs = [wp.empty(count, dtype=t, device="cpu") for t in types]
    inputs = [
        lights.upload(table, 10.0, "cpu"),
        texture.upload(textures, "cpu"),
        wp.array(np.ascontiguousarray(places), dtype=wp.vec3, device="cpu"),
        wp.array(point, dtype=wp.vec2d, device="cpu"),
    ]
    wp.launch(_direct_kernel(features), count, inputs=[*inputs, *outputs], device="cpu")
    return Ways(*(out.numpy().astype(np.float64) for out in outputs))


def emitted(
    table: LightTable,
    count: int,
    textures: Sequence[Texture] = (),
    targets: tuple[Rows, Rows] | None = None,
    shares: Array | None = None,
    seed: int = 0,
    features: Features = ALL,
) -> Photons:
    """Photons of the lights, aimed at `targets` if there are any."""
    rng = np.random.default_rng(seed)
    center, radius = targets or (np.zeros((0, 3), np.float32), np.zeros(0, np.float32))
    types = [wp.int32, wp.int32, wp.vec3, wp.vec3, wp.vec3, wp.int32]
    outputs = [wp.empty(count, dtype=t, device="cpu") for t in types]
    inputs = [
        lights.upload(table, 10.0, "cpu"),
        texture.upload(textures, "cpu"),
        lights.upload_shares(table.power if shares is None else shares, "cpu"),
        lights.upload_targets(np.asarray(center, np.float32), np.asarray(radius, np.float32), "cpu"),
        int(targets is not None),
        wp.array((rng.permutation(count) + 0.5) / count, dtype=wp.float64, device="cpu"),
        wp.array(numbers(count, seed + 1), dtype=wp.vec2, device="cpu"),
        wp.array(numbers(count, seed + 2), dtype=wp.vec2, device="cpu"),
        wp.array(numbers(count, seed + 3, 1)[:, 0], dtype=wp.float32, device="cpu"),
    ]
    wp.launch(_emission_kernel(features), count, inputs=[*inputs, *outputs], device="cpu")
    return Photons(*(out.numpy().astype(np.float64) for out in outputs))


def irradiance(ways: Ways, normal: Sequence[float] = (0.0, 0.0, 1.0)) -> tuple[Array, Array]:
    """Estimate of the irradiance on a plane by RGB, and its standard error."""
    cosine = np.maximum(ways.direction @ np.asarray(normal, np.float64), 0.0)
    found = ways.pdf > 0
    weight = np.divide(cosine, ways.pdf, out=np.zeros_like(cosine), where=found)
    terms = ways.radiance * weight[:, None]
    return terms.mean(axis=0), terms.std(axis=0) / np.sqrt(len(terms))


def without_power(table: LightTable, elements: Sequence[int]) -> LightTable:
    """The table with the power of some elements set to zero."""
    power = table.power.copy()
    power[list(elements)] = 0.0
    return replace(table, power=power)


POINT = PointLight("point", (1.0, 2.0, 2.0), (1.0, 2.0, 3.0))
SPOT = SpotLight("spot", look_at((1, -1, 3), (0, 0.2, 0), (0, 1, 0)), (4.0, 5.0, 6.0), 30.0, 20.0)
PROJECTOR = ProjectorLight(
    "projector", look_at((1, -1, 3), (0, 0.2, 0), (0, 1, 0)), (4.0, 5.0, 6.0), fov=70.0, aspect=1.4
)
SUN = DirectionalLight("sun", (0.6, 0.0, -0.8), (1.0, 0.5, 0.25))


def sky(height: int = 9, width: int = 16, seed: int = 0) -> Environment:
    """A map with a spot a thousand times as bright as the rest, turned and tilted."""
    pixels = np.random.default_rng(seed).uniform(0.0, 1.0, (height, width, 3)).astype(np.float32)
    pixels[height // 4, width // 2] = 1000.0
    pixels[height // 2, : width // 4] = 0.0
    return Environment("sky", pixels, look_at((0, 0, 0), (1, 2, 3), (0, 0, 1)))


KINDS: dict[str, tuple[list[Light], Features]] = {
    "none": ([], Features()),
    "points": ([POINT], Features(points=True)),
    "spots": ([SPOT], Features(spots=True)),
    "projectors": ([PROJECTOR], Features(projectors=True)),
    "directionals": ([SUN], Features(directionals=True)),
    "environment": ([sky()], Features(environment=True)),
}
