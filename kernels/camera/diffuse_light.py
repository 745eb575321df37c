"""Where camera paths find the indirect light that the diffuse parts of surfaces reflect."""

from __future__ import annotations

from enum import IntEnum


class DiffuseLight(IntEnum):
    """A choice for a whole image. Kernels know its numbers as BY_MAP, BY_PATHS and BY_FINAL_GATHER (vertices)."""

    PHOTON_MAP = 0
    """Photons, where the camera path meets the surface. No diffuse part is traced on."""
    PATHS = 1
    """Rays that go on by diffuse parts like by glossy ones: path tracing. Media scatter paths, too."""
    FINAL_GATHER = 2
    """One ray that goes on by the first diffuse part, and photons where it arrives."""
