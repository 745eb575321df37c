"""The space that everything is computed in: the scene's middle is its origin, half the scene's longest side its unit.

Moved and divided in double, before anything is rounded to float32. So a model far from the origin keeps its detail,
no square leaves float32's range however large or small a scene's unit of length makes its numbers, and the image of a
scene is the same in metres and in millimetres: its corners are the same floats but where the doubles of the file, which
round differently in other units, lie within 2^-53 of the middle between two.

Radiance has no length in it. Intensities [W/sr] are divided by the unit's square, extinction [1/m] is multiplied by the
unit; what a render tells of lengths and powers is turned back (FlatScene.unit).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wdpm.scenes.model.bounds import bounding_box
from wdpm.scenes.model.bsdfs import Bsdf, BumpMap
from wdpm.scenes.model.lights import Light
from wdpm.scenes.model.scene import Camera, Material, Medium, Solid
from wdpm.scenes.model.volumes import Volume

Array = NDArray[np.float64]

NOTHING = 2.0**-48
"""Coordinates up to this are 0: the rounding of a difference of doubles, whose sign would be another in other units.

As kernels.constants.OFFSET_MIN_SHARE: no ray tells such a length."""


@dataclass(frozen=True, eq=False)
class RendererSpace:
    """Where things of a scene are for the renderer.

    Attributes:
        center: what is its origin, in the scene's coordinates, float64, shape [3].
        unit: its unit of length, in the scene's.
    """

    center: Array
    unit: float

    def place(self, points: ArrayLike) -> Array:
        """Points of the scene, shape [..., 3]."""
        moved: Array = (np.asarray(points, np.float64) - self.center) / self.unit
        moved[np.abs(moved) <= NOTHING] = 0.0
        return moved

    def placing(self, to_world: Array) -> Array:
        """The matrix that takes points of a shape here, shape [3, 4], from the one that takes them to the world."""
        matrix = np.array(to_world[:3], np.float64)
        matrix[:, 3] -= self.center
        return matrix / self.unit

    def camera(self, camera: Camera) -> Camera:
        """A camera that sees the same."""
        to_world = self._frame(camera.to_world)
        if camera.orthographic:
            to_world[:3, :2] /= self.unit  # the image plane is as wide as these columns are long
        return replace(
            camera,
            to_world=to_world,
            near_clip=camera.near_clip / self.unit,
            far_clip=camera.far_clip / self.unit,
            aperture_radius=camera.aperture_radius / self.unit,
            focus_distance=camera.focus_distance / self.unit,
        )

    def light(self, light: Light) -> Light:
        """A light of the same radiance or irradiance where it arrives."""
        return light.moved(self.place, self.unit)

    def medium(self, medium: Medium) -> Medium:
        """A medium of the same optical depth."""
        return replace(
            medium,
            sigma_t=_times(medium.sigma_t, self.unit),
            density=self._volume(medium.density),
            albedo_volume=self._volume(medium.albedo_volume),
        )

    def _volume(self, volume: Volume | None) -> Volume | None:
        """A volume at the same place."""
        if volume is None:
            return None
        to_world = np.array(volume.to_world, np.float64)
        to_world[:3, 3] -= self.center
        to_world[:3] /= self.unit
        return replace(volume, to_world=to_world)

    def material(self, material: Material) -> Material:
        """A material of bumps as steep."""
        bsdf = self._bsdf(material.bsdf)
        return material if bsdf is material.bsdf else replace(material, bsdf=bsdf)

    def _bsdf(self, bsdf: Bsdf) -> Bsdf:
        changed: dict[str, object] = {}
        for part in fields(bsdf):
            value = getattr(bsdf, part.name)
            if isinstance(value, Bsdf):
                new = self._bsdf(value)
                if new is not value:
                    changed[part.name] = new
        if isinstance(bsdf, BumpMap):
            changed["scale"] = bsdf.scale / self.unit
        return replace(bsdf, **changed) if changed else bsdf

    def _frame(self, to_world: Array) -> Array:
        moved = np.array(to_world, np.float64)
        moved[:3, 3] = self.place(moved[:3, 3])
        return moved


def renderer_space(meshes: Sequence[Solid]) -> RendererSpace:
    """The space of a scene of these meshes: their bounding box reaches from -1 to 1 along its longest side.

    Raises:
        SceneError: there are no triangles.
    """
    low, high = bounding_box(meshes)
    half = float(np.max(high / 2.0 - low / 2.0))
    return RendererSpace((low + high) / 2.0, half if half > 0 else 1.0)


def _times(values: Sequence[float], factor: float) -> tuple[float, float, float]:
    red, green, blue = (float(value) * factor for value in values)
    return red, green, blue
