"""Lights, all that kernels and hosts ask of them: light_elements (choice), direct_light, emission, photon_targets."""

from __future__ import annotations

import functools
from types import SimpleNamespace

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.lights.direct import DirectSample, make_direct
from wdpm.kernels.lights.elements import Lights, upload, upload_shares
from wdpm.kernels.lights.emission import Emission, make_emission
from wdpm.kernels.lights.photon_targets import Targets, upload_targets
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
    "cluster_targets",
    "concentric_disk",
    "make_lights",
    "triangle_areas",
    "upload",
    "upload_shares",
    "upload_targets",
]


@functools.cache
def make_lights(features: Features) -> SimpleNamespace:
    """Functions of lights: those of direct_light.make_direct, and `emit`.

    Glowing triangles are always there; points, spots, directionals, the environment and textured lights where features
    say so.
    """
    return SimpleNamespace(**vars(make_direct(features)), **vars(make_emission(features)))
