"""Section 4: split planes in the worst places, and bands of the wrong width."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from case import Run, hard_case, imbalance
from partitions import in_renderer, planes, with_tree
from rooms import effects_room, glowing_box, lit_room

from wdpm.cluster.render_settings import RenderSettings, Routing
from wdpm.images.image import Image
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes.model.scene import Scene

SAME = {"expected": "the image of one cell (symmetry)", "tolerance": "none: every bit"}


def _settings(full: bool) -> RenderSettings:
    photons = 20_000 if full else 1_500
    return RenderSettings(
        photons=photons, caustic_photons=photons, volume_photons=photons, spp=4 if full else 2, all_effects=True
    )


def _same(run: Run, what: Scene, reference: Image, axis: list[int], split: list[float], name: str) -> None:
    """A render with this top tree has the bits of the reference, and stores the same photons."""
    with with_tree(axis, split):
        image = render_in_process(what, _settings(run.full), workers=2, cells=len(axis) + 1)
    run.demand(f"the same bits, {name}", image.digest() == reference.digest())
    counts = [i.metadata["report"]["photons"]["stored"] for i in (image, reference)]
    run.check(f"photons stored, {name}", counts[0], counts[1], 0)
    run.check(f"gathers that left their band, {name}", image.metadata["report"]["gathers_left_band"], 0, 0)


@hard_case(
    "planes along surfaces", section=4, shows="split planes in a floor full of photons, and a float beside it", **SAME
)
def along_surfaces(run: Run) -> None:
    """Planes through the floor (and so through its photons), a float above it, and a float below."""
    for what in (lit_room(), effects_room()) if run.full else (lit_room(),):
        reference = run.render(what, settings=_settings(run.full), cells=1)
        floor = in_renderer(what, (0.0, -1.0, 0.0))[1]
        ceiling = in_renderer(what, (0.0, 1.0, 0.0))[1]
        for name, towards in (("below", np.float32(-np.inf)), ("in", None), ("above", np.float32(np.inf))):
            y, top = (float(v if towards is None else np.nextafter(v, towards)) for v in (floor, ceiling))
            _same(run, what, reference, [1, 0, 1], [y, 0.0, top], f"{what.name}: {name} floor and ceiling")


@hard_case(
    "planes through everything", section=4, shows="eight cells that meet in a corner, in the lamp, in the air", **SAME
)
def through_everything(run: Run) -> None:
    """Eight cells that meet in a corner of the room, in the middle of the lamp, and where nothing is."""
    what = effects_room()
    reference = run.render(what, settings=_settings(run.full), cells=1)
    places = {"a corner": (-1.0, -1.0, -1.0), "the lamp": (0.0, 0.97, 0.0), "the air": (0.11, 0.07, -0.13)}
    for name, place in places.items():
        axis, split = planes(what, [(a, place[a]) for a in range(3)])
        _same(run, what, reference, axis, split, f"planes through {name}")


@hard_case("planes through photons", section=4, shows="split planes at the very coordinates of photons", **SAME)
def through_photons(run: Run) -> None:
    """Planes at coordinates of photons themselves: each has one owner."""
    from wdpm.cluster.plan import render_plan

    what = lit_room()
    chosen = _settings(run.full)
    found: list[np.ndarray] = []
    own = render_plan.build_top_tree

    def listen(corners: np.ndarray, photons: np.ndarray, *rest: object) -> object:
        found.append(photons)
        return own(corners, photons, *rest)  # type: ignore[arg-type]

    render_plan.build_top_tree = listen  # type: ignore[assignment]
    try:
        run.render(what, settings=chosen, cells=2)  # where there is one cell nobody looks for planes
    finally:
        render_plan.build_top_tree = own
    reference = run.render(what, settings=chosen, cells=1)
    photons = found[0]
    rng = np.random.default_rng(4)
    for number in range(8 if run.full else 3):
        x, y, z = (float(photons[rng.integers(len(photons)), a]) for a in range(3))
        _same(run, what, reference, [0, 1, 1, 2, 2, 2, 2], [x, y, y, z, z, z, z], f"planes through photons {number}")


@hard_case("all geometry on one side", section=4, shows="planes beyond the scene, cells without triangles", **SAME)
def all_on_one_side(run: Run) -> None:
    """Planes beyond the scene: cells without triangles, all photons in one cell."""
    what = effects_room()
    reference = run.render(what, settings=_settings(run.full), cells=1)
    for far in (-1e30, 100.0, 1e30):
        _same(run, what, reference, [0, 1, 2], [far, far, far], f"planes at {far:g}")


@hard_case("the same plane again", section=4, shows="one plane in all levels, planes one float apart", **SAME)
def the_same_plane_again(run: Run) -> None:
    """Every level of the tree has one and the same plane: half of the cells are empty sets of points."""
    what = lit_room()
    reference = run.render(what, settings=_settings(run.full), cells=1)
    _same(run, what, reference, [0] * 7, [0.125] * 7, "x = 0.125 seven times")
    slivers = [float(v) for v in np.float32(0.125) + np.arange(7, dtype=np.float32) * np.float32(2.0**-24)]
    _same(run, what, reference, [0] * 7, slivers, "planes a float apart")


@hard_case("1 to 64 cells", section=4, shows="every number of cells, both routings", **SAME)
def any_number_of_cells(run: Run) -> None:
    what = effects_room() if run.full else lit_room()
    reference = run.render(what, settings=_settings(run.full), cells=1)
    for cells in (2, 4, 8, 16, 32, 64) if run.full else (2, 64):
        for routing in Routing if run.full or cells == 64 else (Routing.FORWARD,):
            chosen = replace(_settings(run.full), routing=routing)
            image = render_in_process(what, chosen, workers=min(cells, 3), cells=cells)
            run.demand(f"the same bits in {cells} cells, {routing.value}", image.digest() == reference.digest())


@hard_case("a band wider than the scene", section=4, shows="gather radii of 100 and 1e12", **SAME)
def wide_band(run: Run) -> None:
    """Gathers, and so bands, many times as wide as the scene: every cell has every photon."""
    for radius in (100.0, 1e12):
        chosen = replace(_settings(run.full), radius=radius, caustic_radius=radius)
        image = run.render(lit_room(), settings=chosen, cells=8)
        run.check(f"gathers that left their band of {radius:g}", image.metadata["report"]["gathers_left_band"], 0, 0)


@hard_case("a radius below float spacing", section=4, shows="gather radii of 1e-9 and 1e-15", slow=True, **SAME)
def narrow_radius(run: Run) -> None:
    """Gathers narrower than float spacing find their own place at most: nothing is lost or counted twice."""
    for radius in (1e-9, 1e-15):
        chosen = replace(_settings(run.full), radius=radius, caustic_radius=radius)
        image = run.render(lit_room(), settings=chosen, cells=1)
        report = image.metadata["report"]
        run.check(f"gathers of {radius:g} with fewer than k", report["gathers_truncated"], report["gathers"], 0)
    run.note("slow: as many surface points are made as there may be, 16.8 million, for discs that hold none")


@hard_case(
    "a band of zero",
    section=4,
    shows="bands of 0, 1e-12 and half of the radius, with --inexact",
    expected="finite values, a closed ledger, and gathers that left the band counted",
    tolerance="1e-5 of the energy; the image itself is approximate",
)
def narrow_band(run: Run) -> None:
    """Bands of zero and below float spacing: approximate, and said so; energy and numbers stay sound."""
    what = glowing_box()
    for band in (0.0, 1e-12, 0.5):
        chosen = replace(_settings(run.full), band=band, inexact=True)
        with with_tree([0, 1, 1], [0.0, 0.0, 0.0]):
            image = render_in_process(what, chosen, workers=2, cells=4)
        run.demand_sound(image)
        run.check(f"imbalance with a band of {band:g}", imbalance(image), 0, 1e-5)
        if band < 0.5:  # gathers that find k photons within half of the radius need no more
            run.demand(f"gathers that left a band of {band:g}", image.metadata["report"]["gathers_left_band"] > 0)
    run.show(image.pixels)
