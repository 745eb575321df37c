"""How indirect light on diffuse surfaces is estimated, with photons."""

from __future__ import annotations

from enum import Enum


class Indirect(Enum):
    """How indirect light on diffuse surfaces is estimated, with photons."""

    AUTO = "auto"
    """One of the others, as it suits the scene and the number of samples; the report says which and why."""
    MAP = "map"
    """The photon map, where the camera path meets the surface."""
    GATHER = "gather"
    """One ray a sample, and the photon map where it arrives (final gathering)."""
    CACHE = "cache"
    """Final gathering at some places, and interpolation between them (irradiance caching)."""
