"""Clear daylight as an environment map: the sky and the sun of Hosek and Wilkie.

"An Analytic Model for Full Spectral Sky-Dome Radiance", Hosek & Wilkie 2012, with the data that they publish for linear
sRGB; the sun is that of "Adding a Solar-Radiance Function to the Hosek-Wilkie Skylight Model", Hosek & Wilkie 2013, its
radiance averaged over the disc. The units are those of Mitsuba 3's `sunsky`, whose values these are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.model.textures import RGB
from wdpm.scenes.model.transforms import Matrix

DATA = Path(__file__).with_name("sky_data.npz")

SUN_APERTURE = 0.5358  # degrees across, as the sun's radiance function has it
MODEL = "Hosek-Wilkie 2012/2013"

# from the map's axes, where +y is up and u = atan2(x, -z) / 2 pi, to the model's, where +z is up
MAP_TO_MODEL: Matrix = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)

# Mitsuba's scale: the integral of the CIE's y curve [nm], and the sun's data relative to the sky's
_PER_CIE_Y = 1.0 / 106.7502593994140625
_SUN_FACTOR = 467.069280386

_SKY_ROWS = 256  # of a sky alone; it is smooth
_SUN_ROWS = 1024  # then the sun is three texels across, and its edge as soft as one texel
_SUN_POINTS = 64  # per side, of the grid over the square around the sun's disc


@dataclass(frozen=True)
class Daylight:
    """What the model is asked for.

    Attributes:
        sun_direction: towards the sun, unit; +z is the zenith.
        turbidity: of the air, 1 to 10.
        albedo: of the ground, by channel, 0 to 1.
        sky_scale, sun_scale: factors; 0 leaves one out.
        sun_aperture: the sun's width in degrees; the irradiance stays the same.
    """

    sun_direction: tuple[float, float, float]
    turbidity: float = 3.0
    albedo: RGB = (0.3, 0.3, 0.3)
    sky_scale: float = 1.0
    sun_scale: float = 1.0
    sun_aperture: float = SUN_APERTURE

    @property
    def elevation(self) -> float:
        """Of the sun above the horizon, in radians."""
        return math.asin(max(-1.0, min(1.0, self.sun_direction[2])))


def sky_map(light: Daylight) -> NDArray[np.float32]:
    """The radiance from all around as pixels of an Environment whose +y is the zenith; MAP_TO_MODEL turns it upright.

    What the model's linear sRGB has below zero, near a low sun, is set to zero. The energy of the sun's disc is kept.

    Returns:
        shape [height, 2 height, 3]; black below the horizon, and everywhere while the sun is down.
    """
    with_sun = light.sun_scale > 0.0
    rows = _SUN_ROWS if with_sun and light.sun_aperture < 8.0 * SUN_APERTURE else _SKY_ROWS
    columns = 2 * rows
    pixels = np.zeros((rows, columns, 3))
    if light.elevation < 0.0:
        return pixels.astype(np.float32)
    if light.sky_scale > 0.0:
        above = _directions(rows, columns)[: rows // 2]
        pixels[: rows // 2] = light.sky_scale * sky_radiance(light, above)
    if with_sun:
        _splat_sun(pixels, light)
    return np.maximum(pixels, 0.0).astype(np.float32)


def sky_radiance(light: Daylight, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Radiance of the sky alone for unit directions that point upwards, before sky_scale; shape [..., 3].

    Hosek & Wilkie 2012, equation 8; the nine coefficients by quintic Bezier curves in the cube root of the sun's
    elevation (section 5.2).
    """
    a, b, c, d, e, f, g, i, h = np.moveaxis(_between(_data()["sky_parameters"], light), -1, 0)
    mean = _between(_data()["sky_radiance"], light)
    cos_theta = np.maximum(directions[..., 2:3], 0.0)
    cos_gamma = np.clip(directions @ np.array(light.sun_direction), -1.0, 1.0)[..., None]
    gamma = np.arccos(cos_gamma)
    chi = (1.0 + cos_gamma**2) / (1.0 + h * h - 2.0 * h * cos_gamma) ** 1.5
    horizon = 1.0 + a * np.exp(b / (cos_theta + 0.01))
    glow = c + d * np.exp(e * gamma) + f * cos_gamma**2 + g * chi + i * np.sqrt(cos_theta)
    return np.asarray(horizon * glow * mean * _PER_CIE_Y)


def sun_radiance(light: Daylight) -> NDArray[np.float64]:
    """Mean radiance of the sun's disc, before sun_scale, shape [3]; 0 while it is down. Hosek & Wilkie 2013, section 4.

    A piecewise cubic in the elevation; its pieces end at the cubes of multiples of a 45th of a right angle.
    """
    if light.elevation < 0.0:
        return np.zeros(3)
    table = _by_turbidity(_data()["sun_radiance"], light.turbidity)
    pieces = len(table)
    piece = min(int(math.cbrt(light.elevation / (math.pi / 2.0)) * pieces), pieces - 1)
    x = light.elevation - math.pi / 2.0 * (piece / pieces) ** 3
    value = table[piece] @ np.array([1.0, x, x * x, x * x * x])
    shrunk = (1.0 - math.cos(math.radians(SUN_APERTURE / 2.0))) / (
        1.0 - math.cos(math.radians(light.sun_aperture / 2.0))
    )
    return np.asarray(value * (_SUN_FACTOR * _PER_CIE_Y * shrunk))


@cache
def _data() -> dict[str, NDArray[np.float64]]:
    with np.load(DATA, allow_pickle=False) as file:
        return {name: file[name].astype(np.float64) for name in file.files}


def _by_turbidity(table: NDArray[np.float64], turbidity: float) -> NDArray[np.float64]:
    low = min(int(turbidity) - 1, len(table) - 2)
    share = turbidity - 1.0 - low
    return np.asarray((1.0 - share) * table[low] + share * table[low + 1])


def _between(table: NDArray[np.float64], light: Daylight) -> NDArray[np.float64]:
    """Coefficients by channel for one turbidity, albedo and elevation, from a table [10, 2, 6, 3, ...]."""
    black, white = _by_turbidity(table, light.turbidity)
    share = np.array(light.albedo).reshape(3, *(1,) * (black.ndim - 2))
    controls = (1.0 - share) * black + share * white
    x = math.cbrt(max(light.elevation, 0.0) / (math.pi / 2.0))
    weights = [math.comb(5, k) * x**k * (1.0 - x) ** (5 - k) for k in range(6)]
    return np.asarray(np.tensordot(weights, controls, axes=1))


def _directions(rows: int, columns: int) -> NDArray[np.float64]:
    """Unit directions of all pixels in the model's space (+z up), shape [rows, columns, 3].

    Columns are centred in their share of the circle; the first and the last row are the zenith and the nadir.
    """
    theta = np.pi * np.arange(rows) / (rows - 1)
    phi = 2.0 * np.pi * (np.arange(columns) + 0.5) / columns
    sin = np.sin(theta)[:, None]
    return np.stack(
        [sin * np.sin(phi), sin * np.cos(phi), np.broadcast_to(np.cos(theta)[:, None], (rows, columns))], axis=2
    )


def _splat_sun(pixels: NDArray[np.float64], light: Daylight) -> None:
    """Adds the sun: points of its disc are shared among the four nearest texels, by the weights of bilinear lookup.

    So the lookup's integral over the sphere is the radiance times the disc's solid angle.
    """
    rows, columns = pixels.shape[:2]
    points, solid_angle = _disc(light)
    x = np.arctan2(points[:, 0], points[:, 1]) / (2.0 * np.pi) * columns - 0.5
    y = np.arccos(np.clip(points[:, 2], -1.0, 1.0)) / np.pi * (rows - 1)
    column, row = np.floor(x).astype(np.int64), np.minimum(np.floor(y).astype(np.int64), rows - 2)
    energy = np.zeros((rows, columns))
    for right in (0, 1):
        for down in (0, 1):
            weight = np.abs(1 - right - (x - column)) * np.abs(1 - down - (y - row))
            np.add.at(energy, (row + down, (column + right) % columns), weight)
    energy *= solid_angle / len(points)
    shown = energy / _texel_solid_angles(rows, columns)[:, None]
    pixels += light.sun_scale * shown[:, :, None] * np.maximum(sun_radiance(light), 0.0)


def _disc(light: Daylight) -> tuple[NDArray[np.float64], float]:
    """Points spread evenly over the sun's disc, unit, shape [N, 3], and its solid angle."""
    half = math.radians(light.sun_aperture / 2.0)
    # equal areas: 1 - cos(angle) grows linearly from ring to ring
    ring, turn = np.divmod(np.arange(_SUN_POINTS * 4 * _SUN_POINTS), 4 * _SUN_POINTS)
    cos = 1.0 - (ring + 0.5) / _SUN_POINTS * (1.0 - math.cos(half))
    phi = 2.0 * np.pi * (turn + 0.5) / (4 * _SUN_POINTS)
    sin = np.sqrt(1.0 - cos * cos)
    axis = np.array(light.sun_direction)
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    points = sin[:, None] * (np.cos(phi)[:, None] * side + np.sin(phi)[:, None] * np.cross(axis, side))
    return points + cos[:, None] * axis, 2.0 * math.pi * (1.0 - math.cos(half))


def _texel_solid_angles(rows: int, columns: int) -> NDArray[np.float64]:
    """Integral of a texel's bilinear weight over the sphere, by row, shape [rows].

    The weight falls linearly to zero over one row's height; times sin(theta) this has a closed form.
    """
    step = np.pi / (rows - 1)
    theta = step * np.arange(rows)
    weights = np.sin(theta) * 2.0 * (1.0 - math.cos(step)) / step
    weights[[0, -1]] = 1.0 - math.sin(step) / step
    return np.asarray(weights * (2.0 * np.pi / columns))


def sun_direction(
    latitude: float, longitude: float, timezone: float, date: tuple[int, int, int], hour: float
) -> tuple[float, float, float]:
    """Where the sun stands, seen from a place on Earth; +x is south, +y west and +z the zenith.

    "Computing the Solar Vector", Blanco-Muriel et al. 2001, good to half a minute of arc from 1999 to 2015. The axes
    are those of Mitsuba 3's `sunsky`.

    Args:
        latitude, longitude: degrees, north and east positive.
        timezone: hours ahead of Greenwich.
        date: year, month and day.
        hour: local time with its fraction.
    """
    hours = hour - timezone
    days = _julian_day_number(*date) - 0.5 + hours / 24.0 - 2451545.0
    node = 2.1429 - 0.0010394594 * days
    anomaly = 6.2400600 + 0.0172019699 * days
    ecliptic = (
        (4.8950630 + 0.017202791698 * days)
        + 0.03341607 * math.sin(anomaly)
        + 0.00034894 * math.sin(2.0 * anomaly)
        - 0.0001134
        - 0.0000203 * math.sin(node)
    )
    obliquity = 0.4090928 - 6.2140e-9 * days + 0.0000396 * math.cos(node)
    ascension = math.atan2(math.cos(obliquity) * math.sin(ecliptic), math.cos(ecliptic))
    declination = math.asin(math.sin(obliquity) * math.sin(ecliptic))
    sidereal = 6.6974243242 + 0.0657098283 * days + hours
    angle = math.radians(sidereal * 15.0 + longitude) - ascension
    north = math.radians(latitude)
    zenith = math.acos(
        math.cos(north) * math.cos(angle) * math.cos(declination) + math.sin(declination) * math.sin(north)
    )
    azimuth = math.atan2(-math.sin(angle), math.tan(declination) * math.cos(north) - math.sin(north) * math.cos(angle))
    zenith += 6371.01 / 149597890.0 * math.sin(zenith)  # seen from the ground, not from Earth's centre
    return -math.sin(zenith) * math.cos(azimuth), -math.sin(zenith) * math.sin(azimuth), math.cos(zenith)


def _julian_day_number(year: int, month: int, day: int) -> int:
    """Of noon on a day of the Gregorian calendar. Fliegel & Van Flandern 1968."""
    early = 1 if month <= 2 else 0
    return (
        1461 * (year + 4800 - early) // 4
        + 367 * (month - 2 + 12 * early) // 12
        - 3 * ((year + 4900 - early) // 100) // 4
        + day
        - 32075
    )
