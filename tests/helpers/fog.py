"""Rooms full of fog, and its single scattering by quadrature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from furnaces import Array, box, scene, view

from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Camera, Medium, Scene
from wdpm.scenes.model.transforms import look_at, scaling

WHITE = (1.0, 1.0, 1.0)
INSIDE = replace(view((0, 0, -0.9), (0, 0, 1), 40), medium=0)


def foggy_furnace(medium: Medium) -> Scene:
    """A closed box that glows with radiance 1, of albedo 1/2, full of a medium: all radiance is 2 if it is white."""
    wall = replace(box((1, 1, 1), inside=True, emission=WHITE), interior=0, exterior=0, bounds=True)
    return replace(scene([wall], INSIDE, (0.5,) * 3), media=(medium,))


HALF = 0.3
"""Half the width of the view."""


def foggy(medium: Medium, albedo: float, **others: object) -> Scene:
    """A room of half length 1 full of a medium, with a point light in it; parallel rays along z look at its middle.

    Rays from one eye would all pass the same few photons next to it, and so be of much the same noise.
    """
    to_world = look_at((0, 0, -0.95), (0, 0, 1), (0, 1, 0)) @ scaling((HALF, HALF, 1))
    camera = replace(Camera(to_world, 1.0, 16, 16, 1e-4, 1e4), orthographic=True, medium=0)
    light = PointLight("lamp", (0.75, 0.1, 0.0), (3.0, 2.0, 1.0), 0)
    what = scene([box((1, 1, 1), inside=True)], camera, (albedo,) * 3, (light,))
    return replace(what, media=(medium,), **others)


def single_scattering(what: Scene) -> Array:
    """Mean over the image of light scattered once in the medium, linear RGB, by quadrature along 32 x 32 rays."""
    medium, light = what.media[0], what.lights[0]
    assert isinstance(light, PointLight)
    sigma_t, g = np.array(medium.sigma_t), medium.g
    across = ((np.arange(32) + 0.5) / 32 * 2 - 1) * HALF
    length = 1.95
    x, y, t = np.meshgrid(across, across, (np.arange(400) + 0.5) / 400 * length, indexing="ij")
    way = np.stack([x, y, t - 0.95], axis=-1) - np.array(light.position)
    distance = np.linalg.norm(way, axis=-1)
    cosine = -way[..., 2] / distance  # between the light's way and the way to the eye
    phase = (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)
    falloff = np.exp(-(t + distance)[..., None] * sigma_t) * (phase / distance**2)[..., None]
    scattered = sigma_t * np.array(medium.albedo) * np.array(light.intensity)
    return np.asarray(falloff.mean(axis=(0, 1, 2)) * length * scattered)
