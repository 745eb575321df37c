"""The scene as loaders leave it: meshes, materials, lights and a camera, in world space, in double precision.

Nothing here knows how it will be rendered. `geometry.flatten` turns it into the arrays that kernels read.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

RGB = tuple[float, float, float]


class Wrap(Enum):
    """What a texture shows outside the unit square."""

    REPEAT = "repeat"
    MIRROR = "mirror"
    CLAMP = "clamp"


class Interpolation(Enum):
    """How a texture is read between texels."""

    BILINEAR = "bilinear"
    NEAREST = "nearest"


@dataclass(frozen=True, eq=False)
class Bitmap:
    """An image texture.

    Attributes:
        name: for messages: the file it came from.
        pixels: linear RGB, float32, shape [height, width, 3]; row 0 is the top of the image, which lies at v = 1.
        to_uv: affine map of texture coordinates applied before the lookup, shape [3, 3] (row vectors of a 2-D
            homogeneous matrix that multiplies the column (u, v, 1)).
    """

    name: str
    pixels: NDArray[np.float32]
    wrap: Wrap = Wrap.REPEAT
    interpolation: Interpolation = Interpolation.BILINEAR
    to_uv: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True, eq=False)
class Material:
    """A diffuse (Lambertian) surface.

    Attributes:
        reflectance: albedo, linear RGB in [0, 1], or a texture of it.
        twosided: whether the back reflects like the front; otherwise it is black.
    """

    name: str
    reflectance: RGB | Bitmap = (0.5, 0.5, 0.5)
    twosided: bool = False


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles of one material, in world space.

    Attributes:
        vertices: float64, shape [V, 3].
        faces: int64 indices into vertices, shape [F, 3]; counter-clockwise seen from the front.
        normals: unit vertex normals for shading, float64, shape [V, 3], or None for flat shading.
        uvs: texture coordinates, float64, shape [V, 2], or None.
        material: index into Scene.materials.
        emission: radiance emitted from the front, linear RGB [W/(m² sr)], or None.
    """

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    normals: NDArray[np.float64] | None
    uvs: NDArray[np.float64] | None
    material: int
    emission: RGB | None = None


@dataclass(frozen=True)
class PointLight:
    """A point that shines alike in all directions.

    Attributes:
        position: world space.
        intensity: radiant intensity, linear RGB [W/sr].
    """

    name: str
    position: tuple[float, float, float]
    intensity: RGB


class FilterKind(Enum):
    """The pixel's reconstruction filter."""

    BOX = "box"
    GAUSSIAN = "gaussian"


@dataclass(frozen=True)
class PixelFilter:
    """The pixel's reconstruction filter; lengths in pixels. A gaussian is cut off and lowered to zero at its radius."""

    kind: FilterKind = FilterKind.BOX
    radius: float = 0.5
    stddev: float = 0.5


@dataclass(frozen=True, eq=False)
class Camera:
    """A perspective camera. It looks along its own +z, +x is to the left of the image and +y is up, as in Mitsuba.

    Attributes:
        to_world: float64, shape [4, 4].
        fov_x: full horizontal field of view of the image, degrees.
        width, height: image size in pixels.
        near_clip, far_clip: distances along the camera's z outside which nothing is seen.
        principal_point: offset of the optical centre from the image's middle to the right and down, as shares of the
            image's width and height.
    """

    to_world: NDArray[np.float64]
    fov_x: float
    width: int = 512
    height: int = 512
    near_clip: float = 1e-2
    far_clip: float = 1e4
    principal_point: tuple[float, float] = (0.0, 0.0)
    filter: PixelFilter = PixelFilter()


@dataclass(frozen=True, eq=False)
class Scene:
    """All that is rendered.

    Attributes:
        samples: samples a pixel that the file asks for, or None.
        max_depth: longest light path in edges that the file asks for, or None for no limit
            (1: emitted light only, 2: direct light, ...; Mitsuba's convention).
        warnings: what the loader ignored, dropped or mended, for the person to read.
    """

    name: str
    meshes: tuple[Mesh, ...]
    materials: tuple[Material, ...]
    point_lights: tuple[PointLight, ...]
    camera: Camera
    samples: int | None = None
    max_depth: int | None = None
    warnings: tuple[str, ...] = ()
