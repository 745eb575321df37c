"""The scene as loaders leave it: meshes, materials, lights and a camera, in world space, in double precision.

Nothing here knows how it will be rendered. `geometry.flatten` turns it into the arrays that kernels read.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.html_tables import html_lines, html_table
from wdpm.scenes.model.bsdfs import GREY, Bsdf, Diffuse, TwoSided
from wdpm.scenes.model.lights import Light
from wdpm.scenes.model.textures import RGB, Color
from wdpm.scenes.model.transforms import Matrix, apply_to_normals, mirrors, placed
from wdpm.scenes.model.volumes import Volume


@dataclass(frozen=True, eq=False)
class Material:
    """What a surface is made of.

    Attributes:
        name: for messages.
        bsdf: how it scatters light.
    """

    name: str
    bsdf: Bsdf


def diffuse(name: str, reflectance: Color = GREY, twosided: bool = False) -> Material:
    """A Lambertian material, black from behind unless it is two-sided."""
    return Material(name, TwoSided(Diffuse(reflectance)) if twosided else Diffuse(reflectance))


@dataclass(frozen=True)
class Medium:
    """A participating medium, homogeneous unless it has a density.

    Attributes:
        sigma_t: extinction by channel [1 / scene unit], where the density is 1.
        albedo: share of the extinction that is scattering, by channel; the largest of each where there is a volume of
            it.
        g: mean cosine of the Henyey-Greenstein phase function, -1 < g < 1; 0 is isotropic.
        density: factor of sigma_t from place to place, of one channel, not negative; None for 1 everywhere.
        albedo_volume: the albedo from place to place, of one channel or three, in [0, 1]; None for `albedo` everywhere.
            Outside of its box it is as at the nearest place of the box.
    """

    name: str
    sigma_t: RGB
    albedo: RGB = (0.75, 0.75, 0.75)
    g: float = 0.0
    density: Volume | None = None
    albedo_volume: Volume | None = None


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles of one material, in world space.

    Attributes:
        vertices: float64, shape [V, 3].
        faces: int64 indices into vertices, shape [F, 3]; counter-clockwise seen from the front.
        normals: unit vertex normals for shading, float64, shape [V, 3], or None for flat shading.
        uvs: texture coordinates, float64, shape [V, 2], or None.
        material: index into Scene.materials.
        emission: radiance emitted from the front, linear RGB [W/(m² sr)] or a texture of it, or None.
        colors: linear RGB at the vertices, float64, shape [V, 3], or None.
        interior, exterior: indices into Scene.media of the media behind and before the surface; None for none.
        bounds: whether the surface separates media at all; where it does not, both are None, and a ray that crosses
            it stays in the medium that it is in.
    """

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    normals: NDArray[np.float64] | None
    uvs: NDArray[np.float64] | None
    material: int
    emission: Color | None = None
    colors: NDArray[np.float64] | None = None
    interior: int | None = None
    exterior: int | None = None
    bounds: bool = False


@dataclass(frozen=True, eq=False)
class Instance:
    """A mesh that stands in several places, in one of them: whoever asks sees a mesh in world space.

    Its vertices are computed anew whenever they are asked for. Who can do with the shape and the matrix holds one
    shape for all its instances (scenes.flat.instances).

    Attributes:
        name: of this one.
        shape: the mesh in a space of its own; the same object in all instances of it.
        to_world: from that space to the world's, affine and invertible, float64, shape [4, 4].
    """

    name: str
    shape: Mesh
    to_world: Matrix

    @property
    def mirrors(self) -> bool:
        """Whether left and right change places. The front of a surface stays its front."""
        return mirrors(self.to_world)

    @property
    def vertices(self) -> NDArray[np.float64]:
        return placed(self.to_world, self.shape.vertices)

    @property
    def faces(self) -> NDArray[np.int64]:
        return self.shape.faces[:, ::-1] if self.mirrors else self.shape.faces

    @property
    def normals(self) -> NDArray[np.float64] | None:
        return None if self.shape.normals is None else apply_to_normals(self.to_world, self.shape.normals)

    @property
    def uvs(self) -> NDArray[np.float64] | None:
        return self.shape.uvs

    @property
    def colors(self) -> NDArray[np.float64] | None:
        return self.shape.colors

    @property
    def material(self) -> int:
        return self.shape.material

    @property
    def emission(self) -> Color | None:
        return self.shape.emission

    @property
    def interior(self) -> int | None:
        return self.shape.interior

    @property
    def exterior(self) -> int | None:
        return self.shape.exterior

    @property
    def bounds(self) -> bool:
        return self.shape.bounds


Solid = Mesh | Instance
"""Whatever has triangles."""


LARGEST_FILTER = 64.0
"""Radius of a pixel filter, in pixels: more is a mistake."""


MESHES_SHOWN = 12
"""In a notebook's table of a scene: the largest."""


class FilterKind(Enum):
    """The pixel's reconstruction filter."""

    BOX = "box"
    GAUSSIAN = "gaussian"
    TENT = "tent"
    MITCHELL = "mitchell"
    LANCZOS = "lanczos"


@dataclass(frozen=True)
class PixelFilter:
    """The pixel's reconstruction filter; lengths in pixels. Along x times along y.

    Attributes:
        radius: where it ends; a lanczos filter has as many lobes.
        stddev: of a gaussian, which is cut off and lowered to zero at its radius.
        b, c: of the cubic of Mitchell and Netravali, 1/3 each in "Mitchell's filter", 0 and 1/2 in Catmull and Rom's.
    """

    kind: FilterKind = FilterKind.BOX
    radius: float = 0.5
    stddev: float = 0.5
    b: float = 1.0 / 3.0
    c: float = 1.0 / 3.0


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera. It looks along its own +z, +x is to the left of the image and +y is up, as in Mitsuba.

    Attributes:
        to_world: float64, shape [4, 4].
        fov_x: full horizontal field of view of the image, degrees.
        width, height: image size in pixels.
        near_clip, far_clip: distances along the camera's z outside which nothing is seen.
        principal_point: offset of the optical centre from the image's middle to the right and down, as shares of the
            image's width and height.
        orthographic: parallel rays; the image plane is then 2 units wide times the scale of to_world's x axis, and
            fov_x means nothing.
        aperture_radius: of a thin lens, in scene units; 0 for a pinhole, which has everything in focus.
        focus_distance: along the camera's z, of the plane that a lens has in focus.
        crop: x, y, width and height in pixels of the part that is rendered, of an image of full_size; None for all.
            width and height above are then the crop's.
        full_size: width and height of the whole image that a crop belongs to; None without a crop.
        medium: index into Scene.media of the medium around the camera, or None.
    """

    to_world: NDArray[np.float64]
    fov_x: float
    width: int = 512
    height: int = 512
    near_clip: float = 1e-2
    far_clip: float = 1e4
    principal_point: tuple[float, float] = (0.0, 0.0)
    filter: PixelFilter = PixelFilter()
    orthographic: bool = False
    aperture_radius: float = 0.0
    focus_distance: float = 1.0
    crop: tuple[int, int, int, int] | None = None
    full_size: tuple[int, int] | None = None
    medium: int | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Scene:
    """All that is rendered.

    Attributes:
        samples: samples a pixel that the file asks for, or None.
        max_depth: longest light path in edges that the file asks for, or None for no limit
            (1: emitted light only, 2: direct light, ...; Mitsuba's convention).
        warnings: what the loader ignored, dropped or mended, for the person to read.
        exposure: that pictures of it are shown with, in stops: radiance is multiplied by 2 to this power. None where
            nobody has said how bright it is meant to be, so that a picture is to tell. It changes no radiance.
    """

    name: str
    meshes: tuple[Solid, ...]
    materials: tuple[Material, ...]
    lights: tuple[Light, ...]
    camera: Camera
    samples: int | None = None
    max_depth: int | None = None
    warnings: tuple[str, ...] = ()
    media: tuple[Medium, ...] = ()
    exposure: float | None = 0.0

    def __repr__(self) -> str:
        """One line, not all its arrays, which a prompt would print and a notebook keep."""
        triangles = sum(len(mesh.faces) for mesh in self.meshes)
        size = f"{self.camera.width}x{self.camera.height}"
        return f"<Scene {self.name!r}: {triangles:,} triangles in {len(self.meshes):,} meshes, {size} pixels>"

    def _repr_html_(self) -> str:
        """What a notebook shows: what is in it, its largest meshes, and the warnings."""
        size = f"{self.camera.width} x {self.camera.height}"
        view = "orthographic" if self.camera.orthographic else f"{self.camera.fov_x:.4g} degrees wide"
        facts = {
            "triangles": f"{sum(len(mesh.faces) for mesh in self.meshes):,} in {len(self.meshes):,} meshes",
            "materials": f"{len(self.materials):,}",
            "lights": f"{len(self.lights):,}, and {sum(mesh.emission is not None for mesh in self.meshes):,} meshes",
            "media": f"{len(self.media):,}",
            "camera": f"{size} pixels, {view}",
        }
        largest = sorted(self.meshes, key=lambda mesh: -len(mesh.faces))[:MESHES_SHOWN]
        rows = [(mesh.name, self.materials[mesh.material].name, f"{len(mesh.faces):,}") for mesh in largest]
        title = "largest meshes" if len(rows) < len(self.meshes) else "meshes"
        tables = html_table(self.name, (), facts.items()) + html_table(title, ("mesh", "material", "triangles"), rows)
        return tables + html_lines(self.warnings)


def horizontal_fov(fov: float, axis: str, aspect: float) -> float:
    """Converts a full field of view to the horizontal one; both in degrees.

    Args:
        axis: "x", "y", "diagonal", "smaller" or "larger": what `fov` refers to.
        aspect: width / height.
    """
    if axis == "smaller":
        axis = "y" if aspect > 1 else "x"
    elif axis == "larger":
        axis = "x" if aspect > 1 else "y"
    half = math.tan(math.radians(fov) / 2.0)
    if axis == "y":
        half *= aspect
    elif axis == "diagonal":
        half *= aspect / math.hypot(aspect, 1.0)
    return math.degrees(2.0 * math.atan(half))
