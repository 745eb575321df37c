"""Lights besides glowing meshes (Mesh.emission)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.model.light_kind import LightKind, LightRow
from wdpm.scenes.model.light_power import pattern_mean, spot_pattern_mean, spot_power, squared_spot_power
from wdpm.scenes.model.textures import RGB, Bitmap

__all__ = ["DirectionalLight", "Environment", "Light", "PointLight", "ProjectorLight", "SpotLight"]

Array = NDArray[np.float64]
Place = Callable[[Any], Array]
"""Where points of the scene, shape [..., 3], are in another space."""


def _identity() -> Array:
    return np.eye(4)


@dataclass(frozen=True)
class Light:
    """A light that belongs to no mesh."""

    name: str

    @property
    def medium(self) -> int | None:
        """Index into Scene.media of the medium around it, or None."""
        return None

    @property
    def at(self) -> Array | None:
        """Where it is, world space, shape [3]; None for what is infinitely far away."""
        return None

    @property
    def orientation(self) -> Array:
        """All numbers that say where it is and where it shines."""
        raise NotImplementedError

    @property
    def strength(self) -> NDArray[np.floating]:
        """All numbers that say how bright it is."""
        raise NotImplementedError

    def moved(self, place: Place, unit: float) -> Light:  # noqa: ARG002 - what is infinitely far away stays
        """The light of the same radiance or irradiance where it arrives, in another space.

        Args:
            unit: the other space's unit of length.
        """
        return self

    def outside_media(self) -> Light:
        """The light in empty space."""
        outside: dict[str, Any] = {"medium": None}
        return self if self.medium is None else replace(self, **outside)


@dataclass(frozen=True)
class DeltaLight(Light):
    """A light without area, which only one direction leads to. KIND says what it calls for."""

    KIND: ClassVar[LightKind]

    @property
    def texture(self) -> Bitmap | None:
        """Factor of its strength by direction, or None."""
        return None

    def row(self) -> LightRow:
        """The light as a row of the light table."""
        raise NotImplementedError

    def power(self, radius: float) -> float:
        """Its flux, mean of RGB [W].

        Args:
            radius: of the scene's sphere, which catches the light of what is infinitely far away.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class PointLight(DeltaLight):
    """A point that shines alike in all directions.

    Attributes:
        position: world space.
        intensity: radiant intensity, linear RGB [W/sr].
        medium: index into Scene.media of the medium around it, or None.
    """

    KIND = LightKind(0, "point", "points")

    position: tuple[float, float, float]
    intensity: RGB
    medium: int | None = None

    @property
    def at(self) -> Array:
        return np.array(self.position, np.float64)

    @property
    def orientation(self) -> Array:
        return self.at

    @property
    def strength(self) -> Array:
        return np.array(self.intensity)

    def moved(self, place: Place, unit: float) -> PointLight:
        x, y, z = place(self.position).tolist()
        return replace(self, position=(x, y, z), intensity=_times(self.intensity, unit**-2.0))

    def row(self) -> LightRow:
        return LightRow(self.intensity, self.position)

    def power(self, radius: float) -> float:  # noqa: ARG002 - all of it is in the scene
        return 4.0 * math.pi * _mean(self.intensity)


@dataclass(frozen=True, eq=False)
class AimedLight(DeltaLight):
    """A point that shines along an axis.

    Attributes:
        to_world: shape [4, 4]; the light sits at the origin and shines along +z.
        intensity: linear RGB [W/sr].
    """

    to_world: Array
    intensity: RGB

    @property
    def at(self) -> Array:
        return np.asarray(self.to_world, np.float64)[:3, 3]

    @property
    def orientation(self) -> Array:
        return self.to_world

    @property
    def strength(self) -> Array:
        return np.array(self.intensity)

    def moved(self, place: Place, unit: float) -> Self:
        to_world = np.array(self.to_world, np.float64)
        to_world[:3, 3] = place(to_world[:3, 3])
        return replace(self, to_world=to_world, intensity=_times(self.intensity, unit**-2.0))


@dataclass(frozen=True, eq=False)
class SpotLight(AimedLight):
    """A point that shines into a cone: full inside beam_width, falling to cutoff_angle, as Mitsuba's `spot` or glTF's.

    Attributes:
        to_world: shape [4, 4]; the light sits at the origin and shines along +z.
        intensity: on the axis, linear RGB [W/sr].
        cutoff_angle, beam_width: half angles in degrees.
        texture: factor of the intensity over the cone, or None.
        squared: whether it falls as the square of a line in the cosine (KHR_lights_punctual), not linearly in the
            angle (Mitsuba).
    """

    KIND = LightKind(1, "spot", "spots", numbers=("beam", "angle", "steepness", "spread"))

    cutoff_angle: float = 20.0
    beam_width: float = 15.0
    texture: Bitmap | None = None
    medium: int | None = None
    squared: bool = False

    def row(self) -> LightRow:
        """Its numbers: cosine of the half angle up to which it is full; the half angle beyond which there is no light
        [radians]; 1 / (that minus the full one), 0 where the edge is sharp; its tangent, which the texture spans.

        Where it is squared, the third is 1 / (the cosine beyond which there is no light minus the first), below 0.
        """
        cutoff, beam = self._angles()
        if self.squared and cutoff > beam:
            steepness = 1.0 / (math.cos(cutoff) - math.cos(beam))
        else:
            steepness = 1.0 / (cutoff - beam) if cutoff > beam else 0.0
        x, y, z = (float(value) for value in self.at)
        return LightRow(
            self.intensity,
            (x, y, z),
            axes_of(self.to_world),
            math.cos(cutoff),
            (math.cos(beam), cutoff, steepness, math.tan(cutoff)),
        )

    def power(self, radius: float) -> float:  # noqa: ARG002 - all of it is in the scene
        cutoff, beam = self._angles()
        power = (squared_spot_power if self.squared else spot_power)(_mean(self.intensity), cutoff, beam)
        return power if self.texture is None else power * spot_pattern_mean(self.texture, cutoff)

    def _angles(self) -> tuple[float, float]:
        """Half angles of no light and of full light, radians."""
        return math.radians(self.cutoff_angle), math.radians(self.beam_width)


@dataclass(frozen=True, eq=False)
class ProjectorLight(AimedLight):
    """A point that throws a picture, as Mitsuba's `projector`: what a perspective camera there would see, reversed.

    Its irradiance on any plane across its axis is that of the picture. Intensity falls off the axis accordingly: it is
    that on the axis over the cosine cubed.

    Attributes:
        to_world: shape [4, 4]; the light sits at the origin and shines along +z, with +x to the picture's left.
        intensity: on the axis where the picture is 1, linear RGB [W/sr].
        fov: horizontal field of view in degrees.
        aspect: width over height of the picture.
        texture: the picture, a factor of the intensity; None for a white one.
    """

    KIND = LightKind(2, "projector", "projectors", numbers=("half_width", "half_height"))

    fov: float
    aspect: float = 1.0
    texture: Bitmap | None = None
    medium: int | None = None

    def row(self) -> LightRow:
        """Its numbers: half the picture's width and height at distance 1. The cone just holds its corners."""
        width, height = self._half_size()
        x, y, z = (float(value) for value in self.at)
        corner = 1.0 / math.sqrt(1.0 + width * width + height * height)
        return LightRow(self.intensity, (x, y, z), axes_of(self.to_world), corner * (1.0 - 1e-6), (width, height))

    def power(self, radius: float) -> float:  # noqa: ARG002 - all of it is in the scene
        width, height = self._half_size()
        power = _mean(self.intensity) * 4.0 * width * height
        return power if self.texture is None else power * pattern_mean(self.texture)

    def _half_size(self) -> tuple[float, float]:
        """Of the picture at distance 1."""
        width = math.tan(math.radians(self.fov) / 2.0)
        return width, width / self.aspect


@dataclass(frozen=True)
class DirectionalLight(DeltaLight):
    """Light of one direction from infinitely far away.

    Attributes:
        direction: in which it travels, world space, unit.
        irradiance: on a plane across it, linear RGB [W/m²].
    """

    KIND = LightKind(16, "directional", "directionals", distant=True)

    direction: tuple[float, float, float]
    irradiance: RGB

    @property
    def orientation(self) -> Array:
        return np.array(self.direction)

    @property
    def strength(self) -> Array:
        return np.array(self.irradiance)

    def row(self) -> LightRow:
        axes = np.zeros((3, 3))
        axes[2] = np.array(self.direction) / np.linalg.norm(self.direction)
        return LightRow(self.irradiance, axes=axes)

    def power(self, radius: float) -> float:
        return math.pi * radius**2 * _mean(self.irradiance)


@dataclass(frozen=True, eq=False)
class Environment(Light):
    """Radiance that arrives from infinitely far away.

    Attributes:
        pixels: linear RGB [W/(m² sr)], float32, shape [height, width, 3], longitude by latitude; the top row is at
            local +y, and (Mitsuba's `envmap`) u = atan2(x, -z) / 2 pi. One pixel: a constant environment.
        to_world: rotation, float64, shape [4, 4].
    """

    pixels: NDArray[np.float32]
    to_world: Array = field(default_factory=_identity)

    @property
    def constant(self) -> bool:
        """Whether the radiance is the same from everywhere."""
        return self.pixels.shape[:2] == (1, 1)

    @property
    def orientation(self) -> Array:
        return self.to_world

    @property
    def strength(self) -> NDArray[np.floating]:
        return self.pixels


DELTA_LIGHTS: tuple[type[DeltaLight], ...] = (PointLight, SpotLight, ProjectorLight, DirectionalLight)
"""All delta lights, by the numbers of their kinds."""


def axes_of(to_world: Array) -> Array:
    """Columns of the matrix' rotation, unit, as rows."""
    columns = np.asarray(to_world, np.float64)[:3, :3]
    unit: Array = (columns / np.linalg.norm(columns, axis=0)).T
    return unit


def _mean(rgb: RGB) -> float:
    return sum(rgb) / 3.0


def _times(values: RGB, factor: float) -> RGB:
    red, green, blue = (float(value) * factor for value in values)
    return red, green, blue
