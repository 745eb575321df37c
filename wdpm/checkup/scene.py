"""Checks of what belongs to a scene as a whole: its size and place, materials, textures, lights and camera."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from wdpm.checkup.findings import Finding, Level
from wdpm.checkup.part import Part, is_solid, is_two_sided
from wdpm.checkup.soup import Soup
from wdpm.checkup.surfaces import Solid
from wdpm.scenes.meshes.framing import glows
from wdpm.scenes.model.bsdfs import Bsdf, Conductor, Diffuse, Plastic, Principled, uses_uvs, walk
from wdpm.scenes.model.scene import Scene
from wdpm.scenes.model.textures import Bitmap, Checkerboard, Color, VertexColors

FAR_OFF = 1e3
"""Distance from the origin, in sizes of the scene, at which float32 coordinates have four of seven digits left."""

SPECK = 1e-5
"""A mesh so much smaller than the scene is drawn with the scene's precision: two of seven digits."""


def check_size(scene: Scene, soup: Soup, cause: NDArray[np.int8]) -> Iterator[Finding]:
    """Size and place: what single precision leaves of the scene."""
    if not (cause == 0).any():
        return
    size = float(np.ptp(soup.reach(cause == 0), axis=0).max())
    distance = float(np.abs(soup.space.center).max()) / soup.space.unit
    coarse = [m for m in scene.meshes if len(m.vertices) and np.array_equal(m.vertices, m.vertices.astype(np.float32))]
    if size > 0 and distance > FAR_OFF * size:
        lost = distance * 2.0**-24 / size
        stored = "; its meshes are stored in single precision, so that is lost already" if coarse else ""
        yield Finding(
            Level.WARNING if coarse else Level.NOTE,
            "far-off",
            f"the scene lies {distance / size:.3g} times its size away from the origin",
            "moves it to the origin in double precision before it rounds",
            "export it near the origin" if coarse else "",
            detail=f"single precision leaves detail of {lost:.1g} of the scene's size there{stored}",
        )
    for number, mesh in enumerate(scene.meshes):
        mine = soup.positions[soup.rows_of(number)][cause[soup.rows_of(number)] == 0]
        if len(mine) and 0 < np.ptp(mine.reshape(-1, 3).astype(np.float64), axis=0).max() < SPECK * size:
            yield Finding(
                Level.WARNING,
                "speck",
                f"meshes smaller than {SPECK:g} of the scene",
                "is exact to the whole scene's size: their shape is rough and rays start well above them",
                "make the rest smaller, or leave them out if they cannot be seen",
                mesh.name,
                total=None,
            )
    yield from _far_camera(scene, soup, size)


def _far_camera(scene: Scene, soup: Soup, size: float) -> Iterator[Finding]:
    places = {"camera": np.asarray(scene.camera.to_world)[:3, 3]}
    for light in scene.lights:
        if light.at is not None:
            places[f'light "{light.name}"'] = light.at
    for name, place in places.items():
        away = float(np.abs(soup.space.place(place)).max())
        if size > 0 and away > FAR_OFF * size:
            yield Finding(
                Level.WARNING,
                "far-camera",
                "a camera or a light very far from everything",
                "takes it for part of the scene: boxes and offsets grow with it",
                "move it nearer; for a light use a directional one",
                detail=f"{name}: {away / size:.3g} sizes of the scene",
            )


def check_materials(scene: Scene, soup: Soup, cause: NDArray[np.int8], solids: list[Solid]) -> Iterator[Finding]:
    """Albedo of 1 and above, and textures on meshes without coordinates."""
    closed = {solid.mesh for solid in solids if solid.inside_out or is_two_sided(Part(scene, soup, solid.mesh).bsdf)}
    for number, material in enumerate(scene.materials):
        worst = _albedo(material.bsdf)
        if worst > 1:
            texts = (
                "reflects more light than arrives",
                "renders it so: light grows at every bounce",
                "lower its reflectance to 0.9 or below",
            )
            yield Finding(Level.WARNING, "albedo-above-1", *texts, material=material.name, detail=f"{worst:.4g}")
        elif worst == 1 and any(scene.meshes[m].material == number for m in closed):
            texts = (
                "reflects all light, in a closed body",
                "follows photons until their path is cut off: slow, and without end in principle",
                "lower its reflectance to 0.99 or below",
            )
            yield Finding(Level.WARNING, "albedo-1", *texts, material=material.name)
    for number in range(len(scene.meshes)):
        yield from _uvs(Part(scene, soup, number), cause)


def _albedo(bsdf: Bsdf) -> float:
    """The largest reflectance in a material, over all texels and channels."""
    names = {Diffuse: "reflectance", Conductor: "specular_reflectance", Plastic: "diffuse_reflectance"}
    names |= {Principled: "base_color"}
    nodes = [node for node in walk(bsdf) if type(node) in names]
    return max((_largest(getattr(node, names[type(node)])) for node in nodes), default=0.0)


def _largest(color: Color | None) -> float:
    if color is None:
        return 0.0
    if isinstance(color, Bitmap):
        return float(color.pixels.max(initial=0.0))
    if isinstance(color, Checkerboard):
        return max(*color.color0, *color.color1)
    return 0.0 if isinstance(color, VertexColors) else max(color)


def _uvs(part: Part, cause: NDArray[np.int8]) -> Iterator[Finding]:
    mesh = part.mesh
    textured = uses_uvs(part.bsdf) or isinstance(mesh.emission, Bitmap | Checkerboard)
    if not textured or not len(mesh.faces):
        return
    if mesh.uvs is None:
        texts = (
            "a texture on a mesh without texture coordinates",
            "shows one point of the texture everywhere",
            "export texture coordinates, or use a plain colour",
        )
        yield part.finding(Level.WARNING, "texture-without-uvs", texts, total=None)
        return
    rows = part.soup.row[part.rows][cause[part.rows] == 0]
    uvs = mesh.uvs[mesh.faces[rows]]
    if not np.isfinite(uvs).all():
        return  # a render refuses it, which is told elsewhere
    a, b = uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]
    flat = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] == 0
    if flat.any():
        local = np.flatnonzero(cause[part.rows] == 0)[flat]
        texts = (
            "textured triangles whose texture coordinates span no area",
            "smears the texture, and takes any tangents there",
            "unwrap them anew",
        )
        level = Level.WARNING if flat.all() else Level.NOTE
        yield part.finding(level, "flat-uvs", texts, local)


def check_lights(scene: Scene, soup: Soup, cause: NDArray[np.int8]) -> Iterator[Finding]:
    """Lights that bring nothing."""
    for number, mesh in enumerate(scene.meshes):
        if mesh.emission is None or not len(mesh.faces):
            continue
        part = Part(scene, soup, number)
        if not (cause[part.rows] == 0).any():
            texts = ("a lamp without area", "has no such lamp", "give it triangles with an area")
            yield part.finding(Level.WARNING, "lamp-without-area", texts, total=None)
        elif not glows(mesh) or (isinstance(mesh.emission, Bitmap | Checkerboard) and _largest(mesh.emission) == 0):
            texts = ("a lamp that emits nothing", "treats it as any other surface", "give it radiance, or no emitter")
            yield part.finding(Level.WARNING, "lamp-without-power", texts, total=None)
    for light in scene.lights:
        if light.strength.max(initial=0.0) <= 0:
            texts = ("a light that emits nothing", "leaves it out", "give it power, or remove it")
            yield Finding(Level.WARNING, "light-without-power", *texts, detail=f'light "{light.name}"')


def check_camera(scene: Scene, soup: Soup, cause: NDArray[np.int8], solids: list[Solid]) -> Iterator[Finding]:
    """A camera that sees nothing, is cut off by its clip planes, or sits in a body."""
    kept = soup.reach(cause == 0)
    if not (cause == 0).any() or not np.isfinite(scene.camera.to_world).all():
        return
    camera, unit = soup.space.camera(scene.camera), soup.space.unit
    eye = np.asarray(camera.to_world)[:3, 3]
    axis = np.asarray(camera.to_world)[:3, 2]
    depth = (kept - eye) @ axis / np.linalg.norm(axis)
    if not (depth > 0).any():
        texts = ("everything lies behind the camera", "sees nothing", "turn the camera round: it looks along its +z")
        yield Finding(Level.WARNING, "camera-sees-nothing", *texts)
        return
    beyond = int((depth > camera.far_clip).sum())
    if beyond:
        texts = ("vertices beyond the far clip distance", "does not see what lies there", "raise far_clip")
        detail = f"far_clip {scene.camera.far_clip:g}, farthest {depth.max() * unit:g}"
        yield Finding(Level.WARNING, "far-clip", *texts, count=beyond, total=len(kept), detail=detail)
    if not (depth > camera.near_clip).any():
        texts = (
            "everything in front of the camera is nearer than its near clip distance",
            "sees nothing",
            "lower near_clip",
        )
        yield Finding(Level.WARNING, "near-clip", *texts, detail=f"near_clip {scene.camera.near_clip:g}")
    elif camera.near_clip > 0.01 * depth.max():
        cut = int(((depth > 0) & (depth < camera.near_clip)).sum())
        texts = ("vertices nearer than the near clip distance", "does not see what lies there", "lower near_clip")
        if cut:
            detail = f"near_clip {scene.camera.near_clip:g}"
            yield Finding(Level.WARNING, "near-clip", *texts, count=cut, total=len(kept), detail=detail)
    if not camera.orthographic:
        yield from _inside(scene, soup, eye, solids)


def _inside(scene: Scene, soup: Soup, eye: NDArray[np.float64], solids: list[Solid]) -> Iterator[Finding]:
    for solid in solids:
        if not ((eye > solid.low) & (eye < solid.high)).all():
            continue
        if not is_inside(eye, soup.positions[solid.triangles].astype(np.float64)):
            continue
        part = Part(scene, soup, solid.mesh)
        glass = is_solid(part.bsdf) and not part.mesh.bounds
        opaque = not part.encloses and not is_two_sided(part.bsdf) and not solid.inside_out
        if glass or opaque:
            does = "looks out of the glass, as if the eye were in it" if glass else "sees its back, which is black"
            advice = (
                "move the camera out, or bring near_clip in front of the body's far side"
                if glass
                else ("move the camera out; if it is a room, turn its faces inwards or make the material two-sided")
            )
            yield part.finding(
                Level.WARNING, "camera-inside", ("the camera is inside a body", does, advice), total=None
            )


def is_inside(point: NDArray[np.float64], corners: NDArray[np.float64]) -> bool:
    """Whether a point is in a closed body: the sum of the solid angles of its triangles is 4 pi, else 0.

    Van Oosterom & Strackee 1983, "The Solid Angle of a Plane Triangle", equation 8.

    Args:
        point: shape [3].
        corners: shape [T, 3, 3].
    """
    a, b, c = (corners - point).swapaxes(0, 1)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    triple = np.einsum("ij,ij->i", a, np.cross(b, c))
    ab, bc, ca = ((x * y).sum(axis=1) for x, y in ((a, b), (b, c), (c, a)))
    angle = 2.0 * np.arctan2(triple, la * lb * lc + ab * lc + bc * la + ca * lb)
    return bool(abs(angle.sum()) > 2.0 * np.pi)
