"""Section 6: normals that lean, bend and vanish."""

from __future__ import annotations

from dataclasses import replace
from math import cos, radians, sin

import numpy as np
from beams import parallel
from case import Run, hard_case, mean_of
from rooms import GREY, box, scene, view
from walls import NO_MAPS, slanted, square, under_sky

from wdpm.images.image import Image
from wdpm.scenes.model.bsdfs import WHITE, Bsdf, Conductor, Diffuse, NormalMap, Plastic, TwoSided
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Material, Mesh
from wdpm.scenes.model.textures import Bitmap, Interpolation


def leaning(angle: float, material: int = 0) -> Mesh:
    """The square at z = 0 that faces -z, with vertex normals that lean by an angle [degrees]."""
    a = radians(angle)
    normal = np.array([sin(a), 0.0, -cos(a)])
    return replace(square(material), normals=np.tile(normal, (4, 1)))


@hard_case(
    "leaning normals",
    section=6,
    shows="a white wall whose normals lean by 0 to 180 degrees",
    expected="(1 + cos a) / 2 up to 90 degrees; black beyond, as seen from behind",
    tolerance="1 %: noise of light samples",
)
def leaning_normals(run: Run) -> None:
    for angle in (0.0, 30.0, 60.0, 89.0):
        what = under_sky(Diffuse(WHITE), leaning(angle), parallel((0, 0, -1), (0, 0, 0), 0.1, 8, up=(0, 1, 0)))
        image = run.render(what, spp=1024 if run.full else 256, **NO_MAPS)
        run.check_share(
            f"leaning by {angle:g} degrees", mean_of(image.pixels), np.full(3, (1 + cos(radians(angle))) / 2), 0.01
        )
    for angle in (91.0, 120.0, 180.0):
        # The front is the side that the normals are on: this one is seen from behind.
        what = under_sky(Diffuse(WHITE), leaning(angle), parallel((0, 0, -1), (0, 0, 0), 0.1, 8, up=(0, 1, 0)))
        run.check(f"leaning by {angle:g} degrees", run.render(what, cells=1, spp=4, **NO_MAPS).pixels, 0.0, 0.0)


@hard_case(
    "wild normals",
    section=6,
    shows="a closed room whose interpolated normals point anywhere, and a lamp outside",
    expected="black",
    tolerance="none",
)
def wild_normals(run: Run) -> None:
    rng = np.random.default_rng(6)
    room = box(inside=True)
    flat = np.cross(*(room.vertices[room.faces[:, i]] - room.vertices[room.faces[:, 0]] for i in (1, 2)))
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    vertices = room.vertices[room.faces].reshape(-1, 3)
    outside = PointLight("outside", (0.0, 3.0, 0.3), (1e6, 1e6, 1e6))
    for name, spread in (("up to 60 degrees", 1.0), ("anyhow", 30.0)):
        normals = np.repeat(flat, 3, axis=0) + spread * rng.normal(size=vertices.shape)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        soup = Mesh("room", vertices, np.arange(36).reshape(-1, 3), normals, None, 0)
        for bsdf in (TwoSided(Diffuse(WHITE)), Conductor(), TwoSided(Plastic(WHITE, alpha=0.1))):
            what = scene([soup], view((0.1, 0.2, -0.3), (0.4, -0.3, 1.0), 90), [Material("wall", bsdf)], [outside])
            image = run.render(what, photons=500, caustic_photons=500, spp=4)
            run.check(f"{type(bsdf).__name__}, normals {name}", image.pixels, 0.0, 0.0)


@hard_case(
    "normal maps of no length",
    section=6,
    shows="normal maps of (0, 0, 0), of half length and of random values",
    expected="as without the map; no more light than the sky has",
    tolerance="1e-6; 30 % in single pixels of random normals: noise",
)
def maps_without_length(run: Run) -> None:
    lamp = PointLight("lamp", (0.3, 0.4, -1.0), (3.0, 2.0, 1.0))
    camera = parallel((0, 0, -1), (0, 0, 0), 0.5, 8, up=(0, 1, 0))

    def seen(bsdf: Bsdf, cells: int = 1) -> Image:
        return run.render(scene([square(0)], camera, [Material("wall", bsdf)], [lamp]), cells=cells, spp=4, **NO_MAPS)

    plain = seen(Diffuse(GREY))
    none = Bitmap("none", np.full((2, 2, 3), 0.5, np.float32))
    run.check("direct light, zero", seen(NormalMap(Diffuse(GREY), none), 4).pixels, plain.pixels, 1e-6)
    rounding = Bitmap("rounding", np.tile(np.array((0.5, 0.5 + 2.0**-24, 0.5), np.float32), (2, 2, 1)))
    bright = seen(NormalMap(Diffuse(GREY), rounding), 4).pixels
    run.demand("no brighter than facing the lamp", bool((bright <= 1.5 * plain.pixels.max()).all()))
    half = np.tile(np.array((0.5, 0.5, 0.75), np.float32), (2, 2, 1))  # (0, 0, 0.5): straight, of half length
    run.check(
        "direct light, half length", seen(NormalMap(Diffuse(GREY), Bitmap("half", half))).pixels, plain.pixels, 1e-6
    )
    rng = np.random.default_rng(2)
    wild = Bitmap("noise", rng.random((16, 16, 3)).astype(np.float32), interpolation=Interpolation.NEAREST)
    image = run.render(under_sky(NormalMap(Diffuse(WHITE), wild), square(), slanted(0.7, 0.5)), spp=256, **NO_MAPS)
    run.demand(
        "no more than the sky, of any normals",
        float(image.pixels.max()) < 1.0 + 0.3,
        f"{image.pixels.max():.4f}",
        "1 and noise",
    )
