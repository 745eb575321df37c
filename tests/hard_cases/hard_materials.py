"""Section 6: materials at their limits."""

from __future__ import annotations

from dataclasses import replace
from math import asin, cos, pi, radians, sin, sqrt
from typing import Any

import numpy as np
from beams import parallel
from case import Run, hard_case, mean_of
from numpy.typing import NDArray
from optics import beckmann_albedo, fresnel, masking, slab_transmission
from rooms import ball, box, glowing_box, lit_room, quad, scene, view
from walls import NO_MAPS, slanted, square, under_sky

from wdpm.scenes.errors import SceneError
from wdpm.scenes.model.bsdfs import (
    WHITE,
    Conductor,
    Dielectric,
    Diffuse,
    Plastic,
    Principled,
    ThinDielectric,
)
from wdpm.scenes.model.lights import PointLight, SpotLight
from wdpm.scenes.model.scene import Material, diffuse
from wdpm.scenes.model.textures import Bitmap, Interpolation
from wdpm.scenes.model.transforms import look_at

Array = NDArray[np.float64]
LARGE = 2.0**100
"""1.27e30."""


# Albedo


@hard_case(
    "albedo 0",
    section=6,
    shows="a room in which nothing reflects",
    expected="no light but the lamp's own; all photons absorbed at once",
    tolerance="none; the ledger to 1e-6",
)
def black(run: Run) -> None:
    room = lit_room()
    dark = replace(room, materials=(diffuse("black", (0.0, 0.0, 0.0), twosided=True),))
    image = run.render(dark, photons=2000, spp=4)
    lamp_alone = run.render(room, cells=1, photons=0, spp=4, max_depth=1)
    run.demand("the lamp's own light and no bit more", np.array_equal(image.pixels, lamp_alone.pixels))
    energy = image.metadata["report"]["energy"]
    run.check_share("absorbed, of what was emitted", energy["absorbed"], energy["emitted"], 1e-6)
    run.check("photons stored", image.metadata["report"]["photons"]["stored"], 0, 0)


@hard_case(
    "closed furnace",
    section=6,
    shows="a closed box that glows, of albedo 0 to 0.99",
    expected="emission / (1 - albedo)",
    tolerance="1 %, and 3 deviations of the number of photons that paths leave",
)
def glowing_walls(run: Run) -> None:
    for albedo in (0.0, 0.5, 0.9, 0.99) if run.full else (0.0, 0.5, 0.9):
        glow = replace(glowing_box((albedo,) * 3), camera=view((0, 0, -0.3), (0, 0, 1), 50))
        photons = 1_000_000 if run.full else 10_000
        image = run.render(glow, photons=photons, k=200, spp=64 if run.full else 16)
        # A path stores 1 / (1 - albedo) photons in the mean, and its length is as noisy as that.
        noise = albedo / sqrt(photons * (1 - albedo))
        run.check_share(
            f"radiance at albedo {albedo}", mean_of(image.pixels), np.full(3, 1 / (1 - albedo)), 0.01 + 3 * noise
        )


# Roughness


@hard_case(
    "roughness of metals",
    section=6,
    shows="white metals of roughness 0, 1e-8, 1e-3, 0.05 and 1 under an even sky",
    expected="1, and the albedo of Beckmann's microfacets by quadrature",
    tolerance="0.5 %, at the small size 2 %: noise of light samples",
)
def rough_metals(run: Run) -> None:
    spp = 1024 if run.full else 64
    for alpha in (0.0, 1e-8, 1e-3, 0.05, 1.0):
        for cosine in (1.0, 0.5):
            albedo = 1.0 if alpha < 1e-2 else beckmann_albedo(alpha, min(cosine, 1 - 1e-9))
            what = under_sky(Conductor(alpha_u=alpha, alpha_v=alpha), square(), slanted(cosine))
            image = run.render(what, cells=1 if cosine == 1.0 else 4, spp=spp, **NO_MAPS)
            run.check_share(
                f"alpha {alpha:g}, cosine {cosine}",
                mean_of(image.pixels),
                np.full(3, albedo),
                0.005 if run.full else 0.02,
            )


@hard_case(
    "nearly smooth",
    section=6,
    shows="the image of a lamp by mirrors, through glass, of roughness 0, 1e-8 and 1e-3",
    expected="the same in all",
    tolerance="1 % at 1e-8; 3 % at 1e-3, which blurs the lamp's rim",
)
def nearly_smooth(run: Run) -> None:
    lamp = quad((-0.5, -0.5, -2), (1, 0, 0), (0, 1, 0), 0, (5.0, 5.0, 5.0))  # faces z
    camera = parallel((0.0, 0.0, -1.0), (0.0, 0.0, 0.0), 0.9, 8, up=(0, 1, 0))
    for name, bsdf in (
        ("metal", lambda a: Conductor(alpha_u=a, alpha_v=a)),
        ("glass", lambda a: Dielectric(1.5, alpha_u=a, alpha_v=a)),
        ("principled metal", lambda a: Principled(WHITE, roughness=a, metallic=1.0)),
    ):
        images = []
        for alpha in (0.0, 1e-8, 1e-3):
            what = scene([lamp, square()], camera, [diffuse("black", (0, 0, 0)), Material(name, bsdf(alpha))])
            images.append(mean_of(run.render(what, cells=1, spp=256 if run.full else 64, **NO_MAPS).pixels)[0])
        run.check_share(f"{name}, 1e-8 against 0", images[1], images[0], 0.01)
        run.check_share(f"{name}, 1e-3 against 0", images[2], images[0], 0.03)
        run.demand(f"{name} shows the lamp", images[0] > 0.01, f"{images[0]:.4g}", "above 0.01")


@hard_case(
    "white things",
    section=6,
    shows="things that absorb nothing, of roughness 0 to 1e-3, under an even sky",
    expected="1: they cannot be seen",
    tolerance="0.5 %, at the small size 2 %: noise",
)
def white_things(run: Run) -> None:
    for name, bsdf in (
        ("glass, alpha 0", Dielectric(1.5)),
        ("glass, alpha 1e-8", Dielectric(1.5, alpha_u=1e-8, alpha_v=1e-8)),
        ("glass, alpha 1e-3", Dielectric(1.5, alpha_u=1e-3, alpha_v=1e-3)),
        ("plastic, alpha 0", Plastic(WHITE, nonlinear=True)),
        ("principled metal, 1e-8", Principled(WHITE, roughness=1e-8, metallic=1.0)),
        ("diffuse", Diffuse(WHITE)),
    ):
        image = run.render(
            under_sky(bsdf, box((1, 1, 1)), view((2.0, 2.5, -3.5), (0, 0, 0), 12)),
            cells=1,
            spp=1024 if run.full else 64,
            **NO_MAPS,
        )
        run.check_share(name, mean_of(image.pixels), np.ones(3), 0.005 if run.full else 0.02)


@hard_case(
    "nearly smooth plastic",
    section=6,
    shows="a white plastic of roughness 1e-8 and 1e-3 under an even sky",
    expected="1, less what Mitsuba 3's mean of 64 reflectances in place of their integral loses in the coat "
    "(2.6 %), by Fresnel's formula and quadrature: colours are to be Mitsuba's",
    tolerance="0.2 %: noise, and the coat's fit",
)
def rough_plastic(run: Run) -> None:
    """The coat of a nearly smooth plastic passes and keeps as much as Mitsuba's, which is not quite all.

    A white base under a coat that keeps the share r of diffuse light from within gives back F + (1 - F) of light at an
    angle of reflectance F, if it reckons with r. Mitsuba 3 (roughplastic.cpp) takes twice the mean of 64 reflectances
    times cosines, at cosines evenly from 0 to 1, in place of their integral r: at both ends that is a little too low.
    """
    eta = Plastic().eta
    middles = (np.arange(100_000) + 0.5) / 100_000
    inner = 2 * float(np.mean(middles * fresnel(middles, 1 / eta)))
    even = np.linspace(0.0, 1.0, 64)[1:]  # at 0 the cosine is 0
    taken = 2 * float(np.sum(even * fresnel(even, 1 / eta))) / 64
    kept = (1 - inner) / (1 - taken)
    run.note(f"of what passes the coat, {1 - kept:.1%} is lost; it is in Mitsuba 3, and colours of scenes depend on it")
    for alpha in (1e-8, 1e-3):
        for cosine in (1.0, 0.5):
            bsdf = Plastic(WHITE, nonlinear=True, alpha=alpha)
            what = under_sky(bsdf, square(), slanted(cosine))
            image = run.render(what, cells=1, spp=1024 if run.full else 256, **NO_MAPS)
            reflected = float(fresnel(cosine, eta))
            expected = np.full(3, reflected + (1 - reflected) * kept)
            run.check_share(f"alpha {alpha:g}, cosine {cosine}", mean_of(image.pixels), expected, 0.002)


# Refraction


@hard_case(
    "indices of refraction",
    section=6,
    shows="a lamp behind slabs and panes of index 1, 1 + 1e-7, 0.5 and 3",
    expected="2 n / (n² + 1) of it: Fresnel's formula at right angles and a geometric series",
    tolerance="2 %: each sample is the lamp or nothing; 1e-6 where nothing is reflected",
)
def indices(run: Run) -> None:
    lamp = quad((-1, -1, 1), (0, 2, 0), (2, 0, 0), 0, (4.0, 4.0, 4.0))  # faces -z
    camera = parallel((0, 0, -1), (0, 0, 1), 0.1, 8, up=(0, 1, 0))
    for eta in (1.0, 1.0 + 1e-7, 0.5, 3.0):
        for name, bsdf, thing in (
            ("slab", Dielectric(eta), box((0.5, 0.5, 0.1), material=1)),
            ("pane", ThinDielectric(eta), square()),
        ):
            if name == "pane" and eta < 1:
                continue
            what = scene([lamp, thing], camera, [diffuse("black", (0, 0, 0)), Material("thing", bsdf)])
            image = run.render(what, cells=4 if eta == 3.0 else 1, spp=4096 if run.full else 256, **NO_MAPS)
            share = 4 * slab_transmission(eta)
            # A sample is the lamp or nothing.
            run.check_share(
                f"{name} of index {eta:.8g}",
                mean_of(image.pixels),
                np.full(3, share),
                1e-6 if abs(eta - 1) < 1e-3 else 0.02,
            )


@hard_case(
    "index 1",
    section=6,
    shows="a ball of index 1, and of the next float, before a pattern",
    expected="the pattern without the ball",
    tolerance="none; 2 % of pixels with the next float, which bends rays by 1e-7",
)
def no_refraction(run: Run) -> None:
    rng = np.random.default_rng(4)
    pattern = Bitmap("pattern", rng.random((16, 16, 3)).astype(np.float32), interpolation=Interpolation.NEAREST)
    wall = replace(quad((-1, -1, 1), (0, 2, 0), (2, 0, 0), 0), emission=pattern)
    camera = view((0, 0, -2), (0, 0, 1), 30, 16, up=(0, 1, 0))
    for eta in (1.0, 1.0 + 1e-7):
        glass = Material("glass", Dielectric(eta))
        with_it = run.render(
            scene([wall, ball(0.5, material=1)], camera, [diffuse("black", (0, 0, 0)), glass]), spp=4, **NO_MAPS
        )
        without = run.render(scene([wall], camera, [diffuse("black", (0, 0, 0))]), cells=1, spp=4, **NO_MAPS)
        # A ray that is bent by 1e-7 may meet the next texel, in one sample of thousands.
        same = np.isclose(with_it.pixels, without.pixels, rtol=1e-5, atol=1e-6).all(axis=2).mean()
        run.check(f"share of equal pixels, index {eta:.8g}", same, 1.0, 0.0 if eta == 1.0 else 0.02)


@hard_case(
    "critical angle",
    section=6,
    shows="the sky from within glass, within 0.3 and down to 1e-7 of the critical angle",
    expected="R + (1 - R) n² by Fresnel's formula; 1 beyond",
    tolerance="2e-7 of angle, as directions are float32, and 4 deviations of noise",
)
def critical_angle(run: Run) -> None:
    eta = 1.5
    critical = asin(1 / eta)
    big = quad((-50, -50, 0), (0, 100, 0), (100, 0, 0), 0)  # its front, the outside, faces -z
    for away in (-0.3, -1e-3, -1e-5, -1e-7, 0.0, 1e-7, 1e-5, 1e-3, 0.3):
        angle = critical + away
        eye = np.array([sin(angle), 0.0, cos(angle)])  # behind: inside
        what = under_sky(Dielectric(eta), big, parallel(3 * eye, (0, 0, 0), 1e-3, 8, up=(0, 1, 0)))
        image = run.render(what, cells=1 if abs(away) < 1e-2 else 4, spp=1024 if run.full else 256, **NO_MAPS)
        # Directions are float32: 2e-7 of angle to either side.
        bounds = [float(r + (1 - r) * eta**2) for r in (fresnel(cos(angle + d), 1 / eta) for d in (-2e-7, 2e-7))]
        seen = mean_of(image.pixels)[0]
        noise = 4 * (eta**2 - 1) * 0.5 / sqrt(64 * (1024 if run.full else 256))
        run.demand(
            f"critical angle {away:+g}",
            min(bounds) - noise <= seen <= max(bounds) + noise,
            f"{seen:.5f}",
            f"{min(bounds):.5f} .. {max(bounds):.5f} ± {noise:.4f}",
        )


# Normals


# Values


@hard_case(
    "radiance of 1e30 and 1e-30",
    section=6,
    shows="a lamp 2^100 times brighter, or darker",
    expected="the same bits but for the exponent",
    tolerance="none",
)
def brightness(run: Run) -> None:
    room = lit_room()
    chosen: dict[str, Any] = {"photons": 2000, "spp": 4}
    plain = run.render(room, **chosen)
    for factor in (LARGE, 1 / LARGE):
        meshes = tuple(
            replace(m, emission=tuple(factor * x for x in m.emission)) if m.emission else m for m in room.meshes
        )
        image = run.render(replace(room, meshes=meshes), **chosen)
        for layer in ("direct", "indirect"):
            equal = np.array_equal(
                image.layers[layer].astype(np.float64) / factor, plain.layers[layer].astype(np.float64)
            )
            run.demand(f"{layer} light times {factor:.3g}, same bits", equal)


@hard_case(
    "reflectance of 1e-30",
    section=6,
    shows="albedos of 2^-100, diffuse and glossy",
    expected="light in proportion to the albedo",
    tolerance="1e-6; 1e-5 of noise in the box",
)
def faint_reflectance(run: Run) -> None:
    lamp = PointLight("lamp", (0.3, 0.4, -1.0), (3.0, 2.0, 1.0))
    camera = parallel((0, 0, -1), (0, 0, 0), 0.5, 8, up=(0, 1, 0))
    for name, bsdf in (
        ("diffuse", lambda x: Diffuse((x, x, x))),
        ("rough metal", lambda x: Conductor(specular_reflectance=(x, x, x), alpha_u=0.5, alpha_v=0.5)),
    ):
        images = [
            run.render(
                scene([square(0)], camera, [Material("wall", bsdf(x))], [lamp]), cells=1, spp=4, **NO_MAPS
            ).pixels.astype(np.float64)
            for x in (1.0, 2.0**-100)
        ]
        run.demand(f"{name} reflects something", float(images[1].max()) > 0, f"{images[1].max():.3g}", "above 0")
        run.check_share(name, images[1] * LARGE, images[0], 1e-6)
    image = run.render(glowing_box((2.0**-100,) * 3), photons=2000, spp=4)
    run.check_share("a closed box of it", mean_of(image.pixels), np.ones(3), 1e-5)


@hard_case(
    "reflectance of 1e30",
    section=6,
    shows="materials that reflect 1e30 times what they get",
    expected="an error that names them, or a finite image",
    tolerance="none",
)
def huge_reflectance(run: Run) -> None:
    for name, bsdf in (
        ("diffuse", Diffuse((1e30, 1e30, 1e30))),
        ("mirror", Conductor(specular_reflectance=(1e30, 1e30, 1e30))),
        ("glass", Dielectric(1.5, specular_transmittance=(1e30, 1e30, 1e30))),
    ):
        room = lit_room(4, [ball(0.4, (0, -0.4, 0.2), 1, 12)], [Material(name, bsdf)])
        try:
            image = run.render(room, cells=1, photons=200, caustic_photons=200, spp=1, max_depth=6)
        except SceneError as error:
            run.demand(
                f"{name} is refused", "1e+30" in str(error) or name in str(error), str(error), "an error that names it"
            )
            continue
        run.demand(f"{name} is finite", bool(np.isfinite(image.pixels).all()))


# Fireflies


def walls_of(half: float) -> list[tuple[Array, Array]]:
    """Eye and target of a view of each wall of a box."""
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    return [((half - 0.5) * axis, half * axis) for axis in axes]


@hard_case(
    "rough caustics",
    section=6,
    shows="a beam on rough glass, and on a rough metal, in a closed room: caustics full of single bright photons",
    expected="the whole flux on the walls, by conservation (of metal: what microfacets reflect, by quadrature)",
    tolerance="1 %, at the small size 3 %; glass of roughness 0.05 hides 0.2 % from itself",
)
def rough_caustics(run: Run) -> None:
    half, albedo = 2.0, 0.5
    power = 2.0 * pi * (1.0 - cos(radians(5.0))) * np.ones(3)
    lamp = SpotLight("beam", look_at((-1.0, 0.3, 0), (0, 0, 0), (0, 1, 0)), WHITE, 5.0, 5.0)
    slab = box((0.1, 0.5, 0.5), material=1)
    turned = quad((-0.5, -0.5, 0.5), (0, 1, 0), (1, 0, -1), 1)  # faces (-1, 0, -1)
    cosine = float(np.array([1.0, -0.3, 0.0]) @ (1, 0, 1) / np.linalg.norm([1.0, 0.3, 0.0]) / sqrt(2.0))
    for name, thing, bsdf, share in (
        ("rough glass", slab, Dielectric(1.5, alpha_u=0.05, alpha_v=0.05), 1.0),
        ("rough metal", turned, Conductor(alpha_u=0.3, alpha_v=0.3), beckmann_albedo(0.3, cosine)),
    ):
        shells = [box((half,) * 3, inside=True), thing]
        materials = [diffuse("wall", (albedo,) * 3), Material(name, bsdf)]
        total = np.zeros(3)
        for number, (eye, target) in enumerate(walls_of(half)):
            camera = parallel(
                eye, target, half, 16 if run.full else 8, up=(0.0, 0.0, 1.0) if abs(target[1]) > 0 else (0.0, 1.0, 0.0)
            )
            image = run.render(
                scene(shells, camera, materials, [lamp]),
                cells=4 if number == 0 else 1,
                photons=0,
                caustic_photons=100_000 if run.full else 4_000,
                spp=32 if run.full else 16,
            )
            total += mean_of(image.layers["caustic"]) * pi / albedo * (2 * half) ** 2
        run.check_share(f"{name}: flux on all walls", total, share * power, 0.01 if run.full else 0.03)


@hard_case(
    "a tiny lamp of a million",
    section=6,
    shows="a rough metal lit by a lamp that rays hardly ever meet by chance",
    expected="Beckmann's density, Smith's masking and the solid angle, by formula: nothing is clamped",
    tolerance="1 %: the lamp is 0.01 across, the mean over seeds",
)
def tiny_lamp(run: Run) -> None:
    alpha, side, radiance = 0.3, 0.01, 1e6
    lamp_at = np.array([-0.5, 0.0, -1.0])
    to_eye = np.array([0.3, 0.0, -1.0])
    to_lamp = lamp_at / np.linalg.norm(lamp_at)
    w = to_eye / np.linalg.norm(to_eye)
    u = np.cross(to_lamp, (0, 1, 0))
    u /= np.linalg.norm(u)
    v = np.cross(to_lamp, u)
    lamp = quad(lamp_at - side / 2 * (u + v), side * v, side * u, 0, (radiance,) * 3)
    if np.cross(v, u) @ to_lamp > 0:
        lamp = replace(lamp, faces=lamp.faces[:, ::-1])
    what = scene(
        [lamp, square()],
        parallel(w, (0, 0, 0), 1e-3, 8, up=(0, 1, 0)),
        [diffuse("black", (0, 0, 0)), Material("metal", Conductor(alpha_u=alpha, alpha_v=alpha))],
    )
    seeds = range(16 if run.full else 4)
    image = np.mean(
        [mean_of(run.render(what, cells=4 if s == 0 else 1, seed=s, spp=64, **NO_MAPS).pixels)[0] for s in seeds]
    )
    h = (w + to_lamp) / np.linalg.norm(w + to_lamp)
    c2 = h[2] ** 2
    density = np.exp(-(1 - c2) / (c2 * alpha**2)) / (pi * alpha**2 * c2**2)
    value = density * masking(alpha, abs(w[2])) * masking(alpha, abs(to_lamp[2])) / (4 * abs(w[2]))
    run.check_share("reflected radiance", image, value * radiance * side**2 / float(lamp_at @ lamp_at), 0.01)


@hard_case(
    "rough glass in a furnace",
    section=6,
    shows="a ball of rough glass in a closed box that glows",
    expected="2 everywhere, through the glass and in all its caustics",
    tolerance="1.5 %, at the small size 4 %: noise, and what microfacets hide",
)
def glass_in_a_furnace(run: Run) -> None:
    room = glowing_box()
    glass = Material("glass", Dielectric(1.5, alpha_u=0.05, alpha_v=0.05))
    photons = 40_000 if run.full else 8_000
    what = replace(room, meshes=(*room.meshes, ball(0.5, (0.3, -0.1, 0.4), 1, 48)), materials=(*room.materials, glass))
    image = run.render(what, photons=photons, caustic_photons=photons, spp=256 if run.full else 32)
    run.check_share("radiance", mean_of(image.pixels), np.full(3, 2.0), 0.015 if run.full else 0.04)
