"""Lights, all that kernels and hosts ask of them: choice, direct, emission, photon_targets."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.lights.direct import DirectCode, make_direct
from wdpm.kernels.lights.elements import Lights, balls, guided, upload, upload_shares
from wdpm.kernels.lights.emission import make_emission
from wdpm.kernels.lights.photon_targets import Targets, upload_targets
from wdpm.kernels.lights.samples import DirectSample, Emission
from wdpm.kernels.lights.target_clusters import cluster_targets
from wdpm.kernels.maths.directions import around, concentric_disk
from wdpm.scenes.flat.areas import triangle_areas

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

__all__ = [
    "DirectSample",
    "Emission",
    "Lights",
    "Targets",
    "around",
    "balls",
    "cluster_targets",
    "concentric_disk",
    "guided",
    "make_lights",
    "triangle_areas",
    "upload",
    "upload_shares",
    "upload_targets",
]


@dataclass(frozen=True, eq=False)
class LightCode(DirectCode):
    """Functions of lights: those of DirectCode, and emission.make_emission's `emit`."""

    emit: wp.Function


@functools.cache
def make_lights(features: Features) -> LightCode:
    """Functions of lights. Glowing triangles are always there; other lights, and textures, where features say so."""
    return LightCode(**vars(make_direct(features)), emit=make_emission(features))
