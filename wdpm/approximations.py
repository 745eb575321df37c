"""What an image only approximates, in words: it goes into the report and the image's header."""

from __future__ import annotations

import numpy as np

from wdpm.cluster.world import World
from wdpm.kernels.settings import RenderSettings
from wdpm.scenes.bsdfs import Conductor, Dielectric, Plastic, Principled, ThinDielectric, walk
from wdpm.scenes.model import Mesh, Scene

RULE = "diffuse parts are gathered, glossy parts are traced, at any roughness"
"""Which light is found how: one rule, without a threshold (kernels.bsdf_types)."""

ROUND_SHARE = 1e-5
"""Vertices of a tessellated sphere lie on it to this share of its radius."""

LEAST_ROUND_TRIANGLES = 100
"""A mesh of fewer triangles is not taken for a sphere: the corners of a cube lie on one, too."""


_SHINY = (Conductor, Dielectric, ThinDielectric, Plastic, Principled)


def approximations(scene: Scene, world: World, settings: RenderSettings) -> tuple[str, ...]:
    """One line for each approximation of a render, with its figures."""
    lines = []
    if world.features.goes_on:
        lines.append(RULE)
    for words, plan in (("indirect light", world.global_map), ("caustics", world.caustic_map)):
        if plan.paths:
            lines.append(f"{words}: averaged over the nearest photons within {plan.radius:.4g}")
    if world.volume_map.paths:
        radius = world.volume_map.radius
        lines.append(f"light scattered in media: averaged over a fixed radius of {radius:.4g} about rays")
        if settings.spp > settings.volume_samples:
            lines.append(f"it is looked for by {settings.volume_samples} of {settings.spp} samples a pixel")
    spheres = [mesh for mesh in scene.meshes if _is_shiny(scene, mesh) and is_round(mesh)]
    if spheres:
        most = max(len(mesh.faces) for mesh in spheres)
        lines.append(f"spheres that reflect or refract: {len(spheres)}, of up to {most:,} triangles, smooth normals")
    if settings.band < 1:
        lines.append(f"overlap band: {settings.band:g} of the gather radius")
    return tuple(lines)


def is_round(mesh: Mesh) -> bool:
    """Whether a mesh is a tessellated sphere: all vertices equally far from their middle, normals along the radius."""
    if mesh.normals is None or len(mesh.faces) < LEAST_ROUND_TRIANGLES:
        return False
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    arm = mesh.vertices - (low + high) / 2.0
    radius = np.linalg.norm(arm, axis=1)
    mean = float(radius.mean())
    if mean == 0 or float(np.abs(radius - mean).max()) > ROUND_SHARE * mean:
        return False
    along = np.abs(np.einsum("ij,ij->i", arm, mesh.normals)) / radius
    return bool(along.min() > 1.0 - ROUND_SHARE)


def _is_shiny(scene: Scene, mesh: Mesh) -> bool:
    return any(isinstance(node, _SHINY) for node in walk(scene.materials[mesh.material].bsdf))
