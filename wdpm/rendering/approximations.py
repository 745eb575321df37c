"""What an image only approximates, in words: it goes into the report and the image's header."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.world import World
from wdpm.kernels.camera.pixel_filter import is_signed, reach_of, sharpening
from wdpm.scenes.flat.material_table import MaterialTable
from wdpm.scenes.model.bsdfs import Leaf, walk
from wdpm.scenes.model.scene import Instance, Mesh, PixelFilter, Scene, Solid

ROUND_SHARE = 1e-5
"""Vertices of a tessellated sphere lie on it to this share of its radius."""

LEAST_ROUND_TRIANGLES = 100
"""A mesh of fewer triangles is not taken for a sphere: the corners of a cube lie on one, too."""


def approximations(scene: Scene, world: World, settings: RenderSettings) -> tuple[str, ...]:
    """One line for each approximation of a render, with its figures."""
    algorithm = settings.algorithm
    lines = [*algorithm.approximations(scene, world.features)]
    for words, plan in (("indirect light", world.global_map), ("caustics", world.caustic_map)):
        if plan.paths:
            lines.append(f"{words}: averaged over the nearest photons within {plan.radius * world.unit:.4g}")
    if settings.final_gathers and _has_layers(world.materials):
        lines.append("indirect light on diffuse parts under gloss: told by its amount and how much of it grazes them")
    if world.volume_map.paths:
        radius = world.volume_map.radius * world.unit
        lines.append(
            f"light scattered in media: averaged over what is inside of a fixed radius of {radius:.4g} about rays"
        )
        if settings.spp > settings.volume_samples:
            lines.append(f"it is looked for by {settings.volume_samples} of {settings.spp} samples a pixel")
    spheres = [mesh for mesh in scene.meshes if _is_shiny(scene, mesh) and is_round(mesh)]
    if spheres:
        most = max(len(mesh.faces) for mesh in spheres)
        lines.append(f"spheres that reflect or refract: {len(spheres)}, of up to {most:,} triangles, smooth normals")
    lines.extend(_of_pixel_filter(scene.camera.filter, settings.spp))
    if settings.band < 1 and "band" not in algorithm.ignored:
        lines.append(f"overlap band: {settings.band:g} of the gather radius")
    return tuple(lines)


def _has_layers(table: MaterialTable) -> bool:
    """Whether something has a diffuse part under gloss that irradiance tells of."""
    leaves = (table.leaf(node) for node in range(len(table)))
    return any(leaf is not None and not leaf[0].lambertian and leaf[0].even(leaf[1]) for leaf in leaves)


def _of_pixel_filter(found: PixelFilter, spp: int) -> Iterator[str]:
    """What samples make of a pixel filter that are not in proportion to it."""
    signed = "; pixels beside edges may be negative" if is_signed(found) else ""
    if reach_of(found):
        yield (
            f"pixel filter: samples count in up to {reach_of(found)} pixels to each side, over the sum of their "
            f"weights; beyond the image there are none{signed}"
        )
    elif signed:
        share = sharpening(found) / spp
        yield (
            f"pixel filter with negative lobes: signed samples, at edges off by at most {share:.2g} of the contrast"
            f"{signed}"
        )


def without_plain_geometry(scene: Scene) -> Scene:
    """The scene with the geometry only that `approximations` looks at: of meshes that do not shine the rest is left."""
    return replace(scene, meshes=tuple(mesh if _is_shiny(scene, mesh) else _bare(mesh) for mesh in scene.meshes))


def _bare(mesh: Solid) -> Solid:
    if isinstance(mesh, Instance):
        return replace(mesh, shape=_bare_mesh(mesh.shape))
    return _bare_mesh(mesh)


def _bare_mesh(mesh: Mesh) -> Mesh:
    nothing, no_faces = np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    return replace(mesh, vertices=nothing, faces=no_faces, normals=None, uvs=None, colors=None)


def settings_without_effect(settings: RenderSettings) -> tuple[str, ...]:
    """One line about settings that were chosen and that nothing looks at; none where there are none."""
    plain, algorithm = RenderSettings(), settings.algorithm
    names = [name for name in algorithm.ignored if getattr(settings, name) != getattr(plain, name)]
    if not names:
        return ()
    return (f"no effect with integrator {algorithm.name}, which {algorithm.why_ignored}: {', '.join(names)}",)


def is_round(mesh: Solid) -> bool:
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


def _is_shiny(scene: Scene, mesh: Solid) -> bool:
    return any(isinstance(node, Leaf) and node.KIND.glossy for node in walk(scene.materials[mesh.material].bsdf))
