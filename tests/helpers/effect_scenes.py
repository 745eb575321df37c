"""Small scenes that call for every effect, in few sets of features: each set compiles kernels of its own.

A room of 2 x 2 x 2 about the origin with things in it; the split planes of the first cells go through them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wdpm.scenes.meshes.mesh_data import MeshData
from wdpm.scenes.meshes.primitives import cube, cylinder, rectangle, sphere
from wdpm.scenes.model.bsdfs import (
    Blend,
    Bsdf,
    BumpMap,
    Conductor,
    Dielectric,
    Diffuse,
    Distribution,
    Mask,
    NormalMap,
    Null,
    Plastic,
    Principled,
    RoughPane,
    ThinDielectric,
    Translucent,
    TwoSided,
)
from wdpm.scenes.model.lights import DirectionalLight, Environment, Light, PointLight, ProjectorLight, SpotLight
from wdpm.scenes.model.scene import Camera, FilterKind, Material, Medium, Mesh, PixelFilter, Scene
from wdpm.scenes.model.textures import RGB, Bitmap, Checkerboard, Interpolation, VertexColors, Wrap
from wdpm.scenes.model.transforms import look_at, rotation, scaling, translation
from wdpm.scenes.model.volumes import Volume

WIDTH, HEIGHT = 16, 12


def random_of(name: str) -> np.random.Generator:
    """Numbers of a name's own: a scene is the same whichever scenes were made before it."""
    return np.random.default_rng([2026, *name.encode()])


def noise(name: str, low: float = 0.1, high: float = 0.9, side: int = 8) -> Bitmap:
    """A texture of random colours."""
    return Bitmap(name, random_of(name).uniform(low, high, (side, side, 3)).astype(np.float32))


NOISE = noise("noise")
NEAREST = replace(
    noise("nearest"), wrap=Wrap.MIRROR, interpolation=Interpolation.NEAREST, to_uv=scaling((3, 2, 1))[:3, :3]
)
HOLES = Bitmap("holes", np.tile(np.float32([[[0.0], [1.0]], [[0.6], [0.3]]]), (1, 1, 3)))
SLOPES = noise("slopes", 0.0, 1.0)
NORMALS = Bitmap(
    "normals", (random_of("normals").uniform(-0.2, 0.2, (8, 8, 3)) * (1, 1, 0) + (0.5, 0.5, 1.0)).astype(np.float32)
)
SQUARES = Checkerboard("squares", (0.8, 0.2, 0.1), (0.1, 0.3, 0.8), scaling((4, 4, 1))[:3, :3])
SKY = random_of("sky").uniform(0.1, 2.0, (6, 12, 3)).astype(np.float32)


def clouds(name: str, place: tuple[float, float, float], size: float, turn: float, channels: int = 1) -> Volume:
    """A box of half length `size`, turned about y, of random numbers from 0 to 0.8, a third of them 0."""
    values = random_of(name).uniform(-0.4, 0.8, (11, 9, 17, channels)).clip(0.0).astype(np.float32)
    turned = translation(place) @ rotation((0.0, 1.0, 0.0), turn) @ scaling((size,) * 3)
    return Volume(name, values, turned @ translation((-1.0, -1.0, -1.0)) @ scaling((2.0, 2.0, 2.0)))


class Builder:
    """Puts meshes and materials together."""

    def __init__(self) -> None:
        self.meshes: list[Mesh] = []
        self.materials: list[Material] = []

    def add(
        self,
        name: str,
        bsdf: Bsdf,
        data: MeshData,
        place: tuple[float, float, float] = (0.0, 0.0, 0.0),
        size: float | tuple[float, float, float] = 1.0,
        turn: float = 0.0,
        *,
        flat: bool = False,
        inside_out: bool = False,
        emission: RGB | Bitmap | VertexColors | None = None,
        colors: bool = False,
        media: tuple[int | None, int | None] | None = None,
    ) -> None:
        """A thing of its own material.

        Args:
            turn: degrees about a slanted axis.
            colors: random colours at the vertices.
            media: inside and outside, where the surface is the boundary of media.
        """
        factors = np.broadcast_to(np.float64(size), 3)
        to_world = translation(place) @ rotation((0.3, 1.0, 0.2), turn) @ scaling(factors)
        vertices = data.vertices @ to_world[:3, :3].T + to_world[:3, 3]
        normals = data.normals @ np.linalg.inv(to_world[:3, :3]) if data.normals is not None else None
        if normals is not None:
            normals = normals / np.linalg.norm(normals, axis=1, keepdims=True) * (-1.0 if inside_out else 1.0)
        self.materials.append(Material(name, bsdf))
        self.meshes.append(
            Mesh(
                name,
                vertices,
                data.faces[:, ::-1] if inside_out else data.faces,
                None if flat else normals,
                data.uvs,
                len(self.materials) - 1,
                emission,
                random_of(name).uniform(0.1, 0.9, (len(vertices), 3)) if colors else None,
                *(media or (None, None)),
                bounds=media is not None,
            )
        )

    def room(self, walls: Bsdf, *, open_to_the_sky: bool = False) -> None:
        """Walls seen from inside; open above and towards the camera where there is a sky."""
        data = cube()
        if open_to_the_sky:
            up = data.vertices[data.faces][:, :, 1].min(axis=1) > 0
            front = data.vertices[data.faces][:, :, 2].max(axis=1) < 0
            data = replace(data, faces=data.faces[~(up | front)])
        self.add("walls", walls, data, flat=True, inside_out=True)

    def lamp(self, emission: RGB | Bitmap = (8.0, 7.0, 6.0)) -> None:
        """A square below the ceiling that shines down."""
        data = rectangle()
        turned = replace(data, vertices=data.vertices[:, [0, 2, 1]], normals=None)  # faces -y
        self.add("lamp", Diffuse((0.0, 0.0, 0.0)), turned, (0.1, 0.97, 0.2), 0.35, emission=emission)

    def ball(
        self, name: str, bsdf: Bsdf, place: tuple[float, float, float], radius: float = 0.35, **others: object
    ) -> None:
        """A smooth ball of few triangles."""
        self.add(name, bsdf, sphere(12), place, radius, **others)  # type: ignore[arg-type]

    def scene(self, name: str, camera: Camera, *lights: Light, media: tuple[Medium, ...] = ()) -> Scene:
        return Scene(name, tuple(self.meshes), tuple(self.materials), lights, camera, media=media)


def camera(**others: object) -> Camera:
    """A camera that looks along z into the room."""
    to_world = look_at((0.12, 0.1, -0.95), (0.0, -0.25, 0.3), (0.02, 1.0, 0.0))
    return replace(Camera(to_world, 75.0, WIDTH, HEIGHT, 1e-2, 1e2), **others)  # type: ignore[arg-type]


def metals() -> Scene:
    """Mirror, rough and anisotropic metal, textured metal, textured lamp, thin lens."""
    b = Builder()
    b.room(Diffuse(NOISE))
    b.lamp(replace(noise("glow", 1.0, 12.0), interpolation=Interpolation.NEAREST))
    b.ball("mirror", Conductor(), (-0.45, -0.5, 0.2))
    b.ball("rough", Conductor((0.2, 0.9, 1.1), (3.9, 2.4, 2.2), alpha_u=0.3, alpha_v=0.3), (0.4, -0.6, 0.0))
    brushed = Conductor(NEAREST, alpha_u=0.05, alpha_v=NOISE, distribution=Distribution.GGX)
    b.add("brushed", brushed, cylinder(12), (0.1, -0.8, 0.6), 0.3, 70.0)
    return b.scene("metals", camera(aperture_radius=0.05, focus_distance=1.2))


def glasses() -> Scene:
    """Smooth and rough glass, a ball in a ball, spot (textured) and point lights, a crop window."""
    b = Builder()
    b.room(TwoSided(Diffuse((0.7, 0.6, 0.5))))
    b.ball("glass", Dielectric(), (-0.4, -0.5, 0.2))
    b.ball("bubble", Dielectric(1 / 1.5), (-0.4, -0.45, 0.2), 0.15)
    b.ball("frosted", Dielectric(1.7, alpha_u=0.2, alpha_v=0.2), (0.45, -0.5, 0.3))
    b.add(
        "diamond", Dielectric(2.4, (1.0, 0.9, 0.8), (0.6, 0.9, 0.7)), cube(), (0.1, -0.8, -0.2), 0.15, 40.0, flat=True
    )
    down = look_at((-0.3, 0.9, 0.1), (-0.3, -0.5, 0.25), (0.0, 0.0, 1.0))
    spots = [
        SpotLight("spot", down, (6.0, 5.0, 4.0), 35.0, 25.0),
        SpotLight("slide", down, (3.0, 3.0, 9.0), 40.0, 10.0, NOISE),
    ]
    crop = camera(crop=(5, 3, WIDTH, HEIGHT), full_size=(24, 18), filter=PixelFilter(FilterKind.GAUSSIAN, 2.0, 0.5))
    return b.scene("glasses", crop, PointLight("point", (0.5, 0.6, -0.2), (1.0, 1.2, 1.4)), *spots)


def coats() -> Scene:
    """Plastics, principled, blends, bump and normal maps, vertex colours, checkerboards, an environment map.

    In a room whose walls have the gloss of glTF's materials.
    """
    b = Builder()
    b.room(TwoSided(Principled(SQUARES, 0.4, layered=True)), open_to_the_sky=True)
    b.ball("plastic", Plastic((0.6, 0.1, 0.1), nonlinear=True), (-0.55, -0.65, 0.0))
    b.ball("satin", Plastic(NOISE, alpha=0.2), (0.5, -0.6, 0.5))
    car = Principled(
        (0.2, 0.3, 0.8), 0.3, 0.4, 0.3, spec_tint=0.3, sheen=0.5, sheen_tint=0.5, clearcoat=0.8, clearcoat_gloss=0.7
    )
    b.ball("car", car, (0.0, -0.6, 0.1), 0.25)
    b.ball("jade", Principled(NOISE, 0.2, spec_trans=0.7, flatness=0.5, eta=1.4), (0.45, -0.7, -0.2), 0.2)
    b.ball("blend", Blend(Conductor(), Diffuse((0.1, 0.8, 0.2)), NOISE), (-0.2, -0.1, 0.6), 0.3)
    b.add("bumps", TwoSided(BumpMap(Diffuse((0.7, 0.7, 0.6)), SLOPES, 0.2)), rectangle(), (-0.6, 0.3, 0.9), 0.3)
    b.add("dents", NormalMap(Plastic((0.2, 0.5, 0.6), alpha=0.1), NORMALS), cube(), (0.6, 0.2, 0.6), 0.2, 50.0)
    b.add("painted", Diffuse(VertexColors("color", 0.9)), cube(), (0.1, 0.4, 0.8), 0.15, 20.0, colors=True)
    sky = Environment("sky", SKY, rotation((1.0, 0.2, 0.3), 30.0))
    return b.scene("coats", camera(), sky)


def panes() -> Scene:
    """Masks, panes, boundaries of nothing, a directional light, a constant environment, an orthographic camera."""
    b = Builder()
    b.room(TwoSided(Diffuse((0.6, 0.6, 0.6))), open_to_the_sky=True)
    b.add("window", ThinDielectric(1.5, (1.0, 0.9, 0.9), (0.9, 1.0, 0.9)), rectangle(), (0.0, 0.0, -0.4), 0.9, 8.0)
    b.add("leaf", Mask(TwoSided(Diffuse((0.2, 0.7, 0.2))), HOLES), rectangle(), (-0.3, -0.2, 0.3), 0.5, 25.0)
    b.add("grille", Mask(Conductor(), 0.4), rectangle(), (0.4, 0.0, 0.5), 0.4, -30.0)
    b.ball("nothing", Null(), (0.3, -0.5, 0.0))
    shade = Blend(TwoSided(Diffuse((0.6, 0.5, 0.3))), Translucent(NOISE), 0.5)
    b.add("shade", shade, cylinder(12), (-0.5, -0.7, 0.0), 0.25, 20.0)
    b.add("frosted", RoughPane((0.8, 0.9, 0.9), NOISE, 1.4, 0.3, 0.2), rectangle(), (0.5, -0.3, 0.2), 0.3, 60.0)
    b.add("block", Diffuse((0.8, 0.3, 0.2)), cube(), (-0.1, -0.8, 0.5), 0.2, 15.0, flat=True)
    sun = DirectionalLight("sun", (0.4, -0.8, 0.4472136), (3.0, 2.8, 2.5))
    wide = camera(
        orthographic=True,
        to_world=look_at((0.1, 0.2, -0.95), (0.0, -0.25, 0.3), (0.02, 1.0, 0.0)) @ scaling((0.8, 0.8, 1)),
    )
    return b.scene("panes", wide, sun, Environment("grey", np.full((1, 1, 3), 0.4, np.float32)))


def fogs() -> Scene:
    """The camera in a medium, another in a box whose boundary is nothing, a third in glass; lamps in two of them."""
    b = Builder()
    b.room(Diffuse((0.7, 0.7, 0.7)))
    b.lamp()
    b.add("smoke", Null(), cube(), (-0.4, -0.5, 0.3), 0.35, 30.0, media=(1, 0))
    b.ball("tea", Dielectric(1.33), (0.45, -0.55, 0.2), 0.3, media=(2, 0))
    b.add("block", Diffuse((0.3, 0.8, 0.4)), cube(), (-0.4, -0.5, 0.3), 0.1, 50.0, flat=True)  # in the smoke
    media = (
        Medium("haze", (0.3, 0.3, 0.4), (0.9, 0.8, 0.7)),
        Medium("smoke", (2.0, 3.0, 4.0), (0.8, 0.8, 0.8), 0.6),
        Medium("tea", (0.5, 2.0, 6.0), (0.5, 0.3, 0.2), -0.3),
    )
    points = (
        PointLight("in the smoke", (-0.4, -0.3, 0.3), (0.5, 0.4, 0.3), 1),
        PointLight("in the haze", (0.5, 0.5, 0.0), (0.3, 0.3, 0.3), 0),
    )
    # The lamp's mesh bounds nothing: what it emits starts in the medium that is said to be around it.
    b.meshes[1] = replace(b.meshes[1], interior=0, exterior=0, bounds=True)
    return b.scene("fogs", camera(medium=0), *points, media=media)


def everything() -> Scene:
    """Nearly all of the above in one."""
    b = Builder()
    b.room(TwoSided(BumpMap(Diffuse(NOISE), SLOPES, 0.05)), open_to_the_sky=True)
    b.lamp(noise("glow", 1.0, 9.0))
    b.ball("glass", Dielectric(1.5), (-0.45, -0.6, -0.1), 0.3, media=(1, None))
    b.ball("metal", Conductor(alpha_u=0.1, alpha_v=0.2), (0.1, -0.7, 0.5), 0.25)
    b.ball("plastic", Plastic(SQUARES, alpha=0.1), (0.55, -0.65, 0.1), 0.25)
    b.ball("car", Principled((0.7, 0.2, 0.1), 0.3, clearcoat=0.5), (-0.1, -0.1, 0.7), 0.25)
    b.ball("blend", Blend(Plastic(), Diffuse(VertexColors("color")), 0.4), (0.6, 0.2, 0.7), 0.2, colors=True)
    b.add("leaf", Mask(TwoSided(NormalMap(Diffuse(), NORMALS)), HOLES), rectangle(), (0.3, 0.0, 0.2), 0.25, 40.0)
    b.add("window", ThinDielectric(), rectangle(), (0.0, 0.1, -0.5), 0.9, 8.0)
    shade = Blend(RoughPane((0.8, 0.9, 0.9), NOISE, 1.4, 0.3, 0.2), Translucent(SQUARES), 0.5)
    b.add("shade", shade, rectangle(), (-0.5, 0.2, 0.4), 0.25, 20.0)
    b.add("smoke", Null(), cube(), (0.3, -0.4, -0.1), 0.25, 30.0, media=(0, None))
    puffs = clouds("puffs", (0.3, -0.4, -0.1), 0.27, 30.0)
    drops = replace(clouds("drops", (-0.45, -0.6, -0.1), 0.25, 10.0), nearest=True)
    media = (
        Medium("smoke", (2.0, 4.0, 6.0), (0.8, 0.8, 0.8), 0.4, puffs, clouds("tints", (0.3, -0.4, -0.1), 0.3, 0.0, 3)),
        Medium("ink", (4.0, 1.0, 1.0), (0.3, 0.5, 0.5), density=drops),
    )
    down = look_at((-0.3, 0.9, 0.1), (-0.4, -0.6, 0.0), (0.0, 0.0, 1.0))
    lights: tuple[Light, ...] = (
        PointLight("point", (0.3, -0.4, -0.1), (0.6, 0.6, 0.5), 0),  # in the smoke
        SpotLight("spot", down, (5.0, 4.0, 3.0), 30.0, 20.0, NOISE),
        ProjectorLight("slide", down, (1.0, 1.5, 2.0), 50.0, 1.3, NOISE),
        DirectionalLight("sun", (0.4, -0.8, 0.4472136), (1.0, 0.9, 0.8)),
        Environment("sky", SKY, rotation((0.1, 1.0, 0.3), 70.0)),
    )
    return b.scene("everything", camera(aperture_radius=0.03, focus_distance=1.1), *lights, media=media)
