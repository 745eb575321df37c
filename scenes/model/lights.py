"""Lights besides glowing meshes (Mesh.emission)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.model.textures import RGB, Bitmap


def _identity() -> NDArray[np.float64]:
    return np.eye(4)


@dataclass(frozen=True)
class PointLight:
    """A point that shines alike in all directions.

    Attributes:
        position: world space.
        intensity: radiant intensity, linear RGB [W/sr].
        medium: index into Scene.media of the medium around it, or None.
    """

    name: str
    position: tuple[float, float, float]
    intensity: RGB
    medium: int | None = None


@dataclass(frozen=True, eq=False)
class SpotLight:
    """A point that shines into a cone, as Mitsuba's `spot`: full inside beam_width, falling linearly to cutoff_angle.

    Attributes:
        to_world: shape [4, 4]; the light sits at the origin and shines along +z.
        intensity: on the axis, linear RGB [W/sr].
        cutoff_angle, beam_width: half angles in degrees.
        texture: factor of the intensity over the cone, or None.
    """

    name: str
    to_world: NDArray[np.float64]
    intensity: RGB
    cutoff_angle: float = 20.0
    beam_width: float = 15.0
    texture: Bitmap | None = None
    medium: int | None = None


@dataclass(frozen=True)
class DirectionalLight:
    """Light of one direction from infinitely far away.

    Attributes:
        direction: in which it travels, world space, unit.
        irradiance: on a plane across it, linear RGB [W/m²].
    """

    name: str
    direction: tuple[float, float, float]
    irradiance: RGB


@dataclass(frozen=True, eq=False)
class Environment:
    """Radiance that arrives from infinitely far away.

    Attributes:
        pixels: linear RGB [W/(m² sr)], float32, shape [height, width, 3], longitude by latitude; the top row is at
            local +y, and (Mitsuba's `envmap`) u = atan2(x, -z) / 2 pi. One pixel: a constant environment.
        to_world: rotation, float64, shape [4, 4].
    """

    name: str
    pixels: NDArray[np.float32]
    to_world: NDArray[np.float64] = field(default_factory=_identity)

    @property
    def constant(self) -> bool:
        """Whether the radiance is the same from everywhere."""
        return self.pixels.shape[:2] == (1, 1)


Light = PointLight | SpotLight | DirectionalLight | Environment
