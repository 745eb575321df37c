"""Scenes whose light is known in closed form, and small helpers to look at them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wdpm.cluster.render_settings import RenderSettings
from wdpm.images.image import Image
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes.meshes.primitives import cube, sphere
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Camera, Mesh, Scene, diffuse
from wdpm.scenes.model.textures import RGB
from wdpm.scenes.model.transforms import look_at

Array = NDArray[np.float64]


def quad(corner: ArrayLike, u: ArrayLike, v: ArrayLike, material: int = 0, emission: RGB | None = None) -> Mesh:
    """The parallelogram corner + [0, 1] u + [0, 1] v; it faces u x v."""
    a, du, dv = (np.asarray(x, np.float64) for x in (corner, u, v))
    vertices = np.array([a, a + du, a + du + dv, a + dv])
    return Mesh("quad", vertices, np.array([[0, 1, 2], [0, 2, 3]]), None, None, material, emission)


def box(size: ArrayLike, centre: ArrayLike = (0, 0, 0), inside: bool = False, emission: RGB | None = None) -> Mesh:
    """A box along the axes, of half lengths `size`; it faces outwards, or inwards."""
    data = cube()
    vertices = data.vertices * np.asarray(size, np.float64) + np.asarray(centre, np.float64)
    return Mesh("box", vertices, data.faces[:, ::-1] if inside else data.faces, None, None, 0, emission)


def hollow_sphere(smooth: bool, emission: RGB | None = None) -> Mesh:
    """The unit sphere seen from inside."""
    data = sphere()
    normals = -data.vertices if smooth else None
    return Mesh("sphere", data.vertices, data.faces[:, ::-1], normals, None, 0, emission)


def view(eye: ArrayLike, target: ArrayLike, fov: float, size: int = 8, up: ArrayLike = (0.1, 1.0, 0.03)) -> Camera:
    """A square image."""
    return Camera(look_at(eye, target, up), fov, size, size, 1e-4, 1e4)


def scene(meshes: list[Mesh], camera: Camera, albedo: RGB, points: tuple[PointLight, ...] = ()) -> Scene:
    """All of one material, that reflects on its front only."""
    return Scene("analytic", tuple(meshes), (diffuse("grey", albedo),), points, camera)


def rendered(what: Scene, **chosen: object) -> Image:
    """The image; fails if a sample was not finite."""
    image = render_in_process(what, RenderSettings(**chosen), workers=1)  # type: ignore[arg-type]
    assert image.metadata["report"]["nonfinite"] == {}
    return image
