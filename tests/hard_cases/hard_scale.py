"""Section 1: the unit of length and the place of the origin are no part of a scene."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from case import HardCase, Run
from numpy.typing import ArrayLike, NDArray
from placing import moved as moved_by
from placing import on_lattice, scaled, scaled_settings, size_of, small
from rooms import ball, effects_room, scene, view

import wdpm
from wdpm.cluster.render_settings import RenderSettings
from wdpm.images.image import Image
from wdpm.kernels.constants import MAX_GATHER_RADIUS, MIN_GATHER_RADIUS
from wdpm.kernels.lights.target_clusters import cluster_targets
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes import atrium, cornell_box
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.scene import Scene

Source = Callable[[], Scene]
AWAY = np.array([1.0, -0.5, 0.25])
"""Direction of moves: each component is a power of two, so that a move of a scene on a lattice rounds nothing."""

POWERS_OF_TWO = (2.0**-20, 2.0**-10, 2.0**10, 2.0**20)
OTHER_SCALES = (1e-6, 1e-3, 1e3, 1e6)
MOVES = (1e3, 1e5, 1e7)

OTHER_PIXELS = 0.1
"""Share of the pixels that may differ in other units. Corners are the same floats there, but for one in some 2^28 that
lies on the middle between two; what it changes is what is seen of its triangles, and the light that it sends on."""

MEAN_IN_UNITS = 1e-3
"""Of direct and of indirect light in other units, by such a corner."""

MOVED_ULPS = 2048.0
"""Of direct light 1e7 sizes away, in the median pixel. The doubles of a file hold a scene there to 1e-9 of its size, so
one coordinate in 60 is the next float, by 6e-8 of the size; lobes of roughness 0.005, and waves of water, turn that
into a thousand times as much of the light."""

MEAN = 5e-3
"""Of direct and of indirect light far away. A photon near an edge may land beyond it, and so may a shadow ray: of the
few thousand photons of these images several do, and what follows from one is other random light."""


def _settings(full: bool) -> RenderSettings:
    photons = 20_000 if full else 2_000
    return RenderSettings(
        photons=photons,
        caustic_photons=photons,
        volume_photons=photons,
        spp=4 if full else 2,
        all_effects=True,
    )


def _image(scene: Scene, full: bool) -> Image:
    return render_in_process(scene, _settings(full), workers=1, cells=1)


def _seen(source: Source, full: bool) -> Scene:
    return small(source(), 32 if full else 12)


def _depth_in_first_units(image: Image, by: float) -> Image:
    """Distances are the one layer that has a unit."""
    depth = (image.layers["depth"].astype(np.float64) / by).astype(np.float32)
    return Image({**image.layers, "depth": depth}, image.metadata)


def ulps(one: ArrayLike, other: ArrayLike) -> NDArray[np.float64]:
    """How many floats lie between two arrays of floats >= 0, float64."""
    a, b = (np.asarray(x, np.float32).view(np.int32).astype(np.int64) for x in (one, other))
    return np.abs(a - b).astype(np.float64)


def same_when_scaled_by_powers_of_two(run: Run, source: Source) -> None:
    """Exponents change, mantissas do not."""
    scene = _seen(source, run.full)
    reference = run.render(scene, settings=_settings(run.full))
    for by in POWERS_OF_TWO if run.full else POWERS_OF_TWO[::3]:
        image = _depth_in_first_units(_image(scaled(scene, by), run.full), by)
        run.demand_sound(image)
        run.demand(f"the same bits, times 2^{np.log2(by):.0f}", image.digest() == reference.digest())


def same_when_moved_exactly(run: Run, source: Source) -> None:
    """Doubles hold the moved scene exactly, so recentring finds the very same one."""
    scene = on_lattice(_seen(source, run.full))
    reference = run.render(scene, settings=_settings(run.full))
    size = 2.0 ** np.ceil(np.log2(size_of(scene)))
    for sizes in (2.0**10, 2.0**17, 2.0**24) if run.full else (2.0**24,):  # 1e3, 1.3e5, 1.7e7 scene sizes
        image = _image(moved_by(scene, AWAY * (sizes * size)), run.full)
        run.demand(f"the same bits, {sizes:g} sizes away", image.digest() == reference.digest())


def alike_in_any_unit(run: Run, source: Source) -> None:
    """All is divided by the scene's own size before it is rounded, so the unit of length is none of the image's."""
    scene = _seen(source, run.full)
    reference = run.render(scene, settings=_settings(run.full), cells=1)
    for by in OTHER_SCALES if run.full else OTHER_SCALES[::3]:
        image = _image(scaled(scene, by), run.full)
        run.demand_sound(image)
        other = np.any(image.pixels != reference.pixels, axis=2).mean()
        run.check(f"share of pixels with other bits, times {by:g}", other, 0, OTHER_PIXELS)
        _same_means(run, reference, image, f"times {by:g}", MEAN_IN_UNITS)
        if other:
            run.note(f"times {by:g}, {other:.2%} of the pixels have other bits")


def alike_when_moved(run: Run, source: Source) -> None:
    """Far from the origin doubles hold a scene to 2^-53 of its distance: 1e7 sizes away, to 1e-9 of its size."""
    scene = _seen(source, run.full)
    reference = run.render(scene, settings=_settings(run.full), cells=1)
    for sizes in MOVES if run.full else MOVES[2:]:
        image = _image(moved_by(scene, AWAY * (sizes * size_of(scene))), run.full)
        _alike(run, reference, image, f"{sizes:g} sizes away")


def _alike(run: Run, reference: Image, image: Image, where: str) -> None:
    run.demand_sound(image)
    one, other = (i.layers["direct"] for i in (reference, image))
    lit = (one > 0) & (other > 0)
    if lit.any():
        typical = np.median(ulps(one, other)[lit])
        run.check(f"ulps of direct light in the median pixel, {where}", typical, 0, MOVED_ULPS)
    _same_means(run, reference, image, where, MEAN)


def _same_means(run: Run, reference: Image, image: Image, where: str, share: float) -> None:
    for layer in ("direct", "indirect"):
        mean, expected = (float(i.layers[layer].mean(dtype=np.float64)) for i in (image, reference))
        run.check_share(f"mean of {layer}, {where}", mean, expected, share)


def bits_in_any_unit(run: Run, source: Source) -> None:
    """Nothing changes at all, in any layer but that of distances, which is multiplied by the unit and rounded again."""
    scene = _seen(source, run.full)
    reference = run.render(scene, settings=_settings(run.full), cells=1)
    for by in (*OTHER_SCALES, 0.3048, 7e-4):
        image = _depth_in_first_units(_image(scaled(scene, by), run.full), by)
        layers = [name for name in reference.layers if name not in ("depth", "cell")]
        same = all(np.array_equal(reference.layers[name], image.layers[name]) for name in layers)
        run.demand(f"the same bits, times {by:g}", same)
        worst = float(ulps(reference.layers["depth"], image.layers["depth"]).max())
        run.check(f"ulps of distance in the worst pixel, times {by:g}", worst, 0, 1)


def given_radii_follow(run: Run) -> None:
    """A person's own radii are lengths of the scene: times 2^20 with it, the image is the same."""
    scene = small(effects_room(), 12)
    chosen = replace(_settings(run.full), radius=0.25, caustic_radius=0.125, volume_radius=0.375)
    reference = run.render(scene, settings=chosen, cells=1)
    for by in (2.0**20, 1000.0):
        image = render_in_process(scaled(scene, by), scaled_settings(chosen, by), workers=1, cells=1)
        run.demand(f"the same bits, times {by:g}", np.array_equal(image.pixels, reference.pixels))


def same_targets(run: Run) -> None:
    """Spheres that caustics are aimed at, about a grid of balls alike: the same ones, in the same order."""
    places = np.stack(np.meshgrid(*[[-2.0, 0.0, 2.0]] * 3), axis=-1).reshape(-1, 3)
    flat = flatten(scene([ball(0.5, place, around=8) for place in places], view((0, 0, -9), (0, 0, 0))))
    corners = flat.triangles.positions
    center, radius = cluster_targets(corners)
    for exponent in range(-20, 21, 4):
        by = np.float32(2.0**exponent)
        other_center, other_radius = cluster_targets(corners * by)
        same = np.array_equal(other_center, center * by) and np.array_equal(other_radius, radius * by)
        run.demand(f"the same spheres, times 2^{exponent}", same)


def small_as_an_atom(run: Run) -> None:
    """No limit of the gather is a length of its own: its bounds lie where float32 can no longer hold squares."""
    run.demand("radii of 1e-18 are let through", MIN_GATHER_RADIUS <= 1e-18)
    run.demand("radii of 1e18 are let through", MAX_GATHER_RADIUS >= 1e18)
    _same_box(run, 2.0**-40)


def large_as_an_orbit(run: Run) -> None:
    _same_box(run, 2.0**30)


def _same_box(run: Run, by: float) -> None:
    scene = small(cornell_box(), 8)
    reference = run.render(scene, settings=_settings(False), cells=1)
    image = _image(scaled(scene, by), False)
    run.demand_sound(image)
    run.demand(
        f"the same bits, times 2^{np.log2(by):.0f}", _depth_in_first_units(image, by).digest() == reference.digest()
    )


def _hall(triangles: int) -> Scene:
    return atrium(triangles)


def _sources() -> Iterator[tuple[str, Source, bool]]:
    """Name, scene, and whether it is for the full size only."""
    yield "cornell box", cornell_box, False
    yield "room of effects", effects_room, False
    yield "atrium", partial(_hall, 20_000), True
    folder = os.environ.get("WDPM_SCENES")
    if folder:
        for file in sorted(Path(folder).glob("*/scene.xml")):
            yield file.parent.name, partial(wdpm.load, file), True


def _cases() -> Iterator[HardCase]:
    for name, source, slow in _sources():
        yield HardCase(
            name=f"{name}: scaled by powers of two",
            section=1,
            shows="all lengths times 2^-20 (1e-6) to 2^20 (1e6); intensities and media follow",
            expected="the image of the scene as it is: radiance has no length in it (symmetry)",
            tolerance="none: a power of two changes exponents only, so every bit must be equal",
            measure=partial(same_when_scaled_by_powers_of_two, source=source),
            slow=slow,
        )
        yield HardCase(
            name=f"{name}: moved exactly",
            section=1,
            shows="moved by 1e3, 1.3e5 and 1.7e7 scene sizes, on a lattice that doubles hold",
            expected="the image of the scene in its place (symmetry)",
            tolerance="none: recentring in double finds the very same coordinates",
            measure=partial(same_when_moved_exactly, source=source),
            slow=slow,
        )
        yield HardCase(
            name=f"{name}: in other units",
            section=1,
            shows="all lengths times 1e-6, 1e-3, 1e3, 1e6",
            expected="the image of the scene as it is (symmetry)",
            tolerance=f"nine in ten pixels the same bits, means {MEAN_IN_UNITS:.1%}: of 2^28 corners one or two are "
            "rounded to the next float",
            measure=partial(alike_in_any_unit, source=source),
            slow=slow,
        )
        yield HardCase(
            name=f"{name}: moved far away",
            section=1,
            shows="moved by 1e3, 1e5 and 1e7 scene sizes",
            expected="the image of the scene in its place (symmetry)",
            tolerance=f"direct light {MOVED_ULPS:.0f} ulps in the median pixel; means {MEAN:.1%}: the doubles of the "
            "file hold a scene 1e7 sizes away to 1e-9 of its size",
            measure=partial(alike_when_moved, source=source),
            slow=slow,
        )
    yield HardCase(
        name="the same bits in any unit",
        section=1,
        shows="all lengths times 1e-6 to 1e6, and 0.3048: every layer",
        expected="the image of the scene as it is (symmetry)",
        tolerance="none; 1 ulp of distances",
        measure=partial(bits_in_any_unit, source=effects_room),
    )
    yield HardCase(
        name="radii that a person gives",
        section=1,
        shows="--radius and the others, with a scene 2^20 and 1000 times larger",
        expected="the same image (symmetry)",
        tolerance="none",
        measure=given_radii_follow,
    )
    yield HardCase(
        name="spheres that caustics are aimed at",
        section=1,
        shows="a grid of 27 glossy balls alike, in units from 2^-20 to 2^20",
        expected="the same spheres in the same order (symmetry)",
        tolerance="none: powers of two",
        measure=same_targets,
    )
    yield HardCase(
        name="as small as an atom",
        section=1,
        shows="a Cornell box 5e-10 long: no limit of the gather is a length of its own",
        expected="the same image (symmetry)",
        tolerance="none: powers of two",
        measure=small_as_an_atom,
    )
    yield HardCase(
        name="as large as an orbit",
        section=1,
        shows="a Cornell box 6e11 long",
        expected="the same image (symmetry)",
        tolerance="none: powers of two",
        measure=large_as_an_orbit,
    )


CASES = tuple(_cases())
