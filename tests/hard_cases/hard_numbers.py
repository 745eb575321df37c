"""Section 8: sums, order, threads, energy, furnaces."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import numpy as np
import warp as wp
from case import HardCase, Run
from rooms import ball, box, effects_room, glowing_box, lit_room, scene, view

from wdpm.cluster.render_settings import RenderSettings
from wdpm.kernels import columns
from wdpm.kernels.camera import add_samples
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes.model.bsdfs import (
    WHITE,
    Blend,
    Bsdf,
    Conductor,
    Dielectric,
    Diffuse,
    Null,
    Plastic,
    Principled,
    ThinDielectric,
)
from wdpm.scenes.model.lights import Environment
from wdpm.scenes.model.scene import Material

SKY = Environment("sky", np.ones((1, 1, 3), np.float32))
METAL = {"eta": (0.0, 0.0, 0.0), "k": (1.0, 1.0, 1.0)}  # reflects everything

WAVE = 1_000_000

FURNACES: dict[str, Bsdf] = {
    "diffuse": Diffuse(WHITE),
    "mirror": Conductor(),
    "rough metal": Conductor(**METAL, alpha_u=0.05, alpha_v=0.05),
    "glass": Dielectric(1.5),
    "rough glass": Dielectric(1.5, alpha_u=0.05, alpha_v=0.05),
    "pane": ThinDielectric(1.5),
    "plastic": Plastic(WHITE, eta=1.5, nonlinear=True),
    "white metal": Principled(WHITE, roughness=0.05, metallic=1.0),
    "blend": Blend(Diffuse(WHITE), Conductor(), 0.3),
    "nothing": Null(),
}


def long_sums(run: Run) -> None:
    """The kernel that adds samples to pixels, wave after wave of the same million samples."""
    waves = 1000 if run.full else 5
    rng = np.random.default_rng(6)
    values = (rng.random((WAVE, 3)) * 10.0 ** rng.uniform(-4, 2, (WAVE, 1))).astype(np.float32)
    none = np.zeros((WAVE, 3), np.float32)
    slots = columns.upload(
        add_samples.Slots,
        {
            "emission": values,
            "indirect": values[::-1].copy(),
            "depth": np.ones(WAVE, np.float32),
            "normal": none,
            "albedo": none,
            "direct": none,
        },
        "cpu",
    )
    no_parts = {
        "begin": np.zeros(WAVE + 1, np.int32),
        "layer": np.zeros(0, np.int32),
        "radiance": np.zeros((0, 3), np.float32),
    }
    parts = columns.upload(add_samples.Parts, no_parts, "cpu")
    sums = columns.zeros(add_samples.Sums, 1, "cpu")
    for _ in range(waves):
        wp.launch(add_samples.add_samples, dim=1, inputs=[slots, parts, WAVE, 1, 0, sums], device="cpu")
    expected = np.array([math.fsum(values[:, c].tolist()) for c in range(3)])
    for name in ("direct", "indirect"):
        total = getattr(sums, name).numpy()[0]
        run.check_share(f"{name}, {waves * WAVE:.0e} samples", total / waves, expected, 1e-7)


def many_samples(run: Run) -> None:
    """One pixel of a black box that glows: each sample is the same float, and so is the mean."""
    radiance = float(np.float32(0.1))
    what = glowing_box((0.0, 0.0, 0.0), (radiance,) * 3, size=1)
    spp = 1 << (22 if run.full else 16)
    image = run.render(what, photons=0, spp=spp, cells=1)
    run.check_share(f"radiance, {spp:,} samples", image.pixels, radiance, 1e-7)


def threads_and_order(run: Run) -> None:
    """One to four threads, messages in shuffled order, other buckets."""
    photons = 20_000 if run.full else 2_000
    chosen = RenderSettings(
        photons=photons, caustic_photons=photons, volume_photons=photons, spp=2, light_samples=2, all_effects=True
    )
    what = effects_room()
    reference = run.render(what, settings=chosen, cells=1)
    for threads in (1, 2, 3, 4):
        image = render_in_process(what, chosen, workers=1, cells=1, threads=threads)
        run.demand(f"the same bits with {threads} threads", image.digest() == reference.digest())
    for seed in range(4 if run.full else 2):
        other = replace(chosen, bucket=(5, 7, 16, 1024)[seed])
        image = render_in_process(what, other, workers=3, cells=4, shuffle=random.Random(seed))
        run.demand(f"the same bits in order {seed}", image.digest() == reference.digest())


def ledger(run: Run) -> None:
    """Rooms of albedo 0.01 to 0.99: what is emitted is absorbed, escapes or is cut off."""
    for albedo in (0.01, 0.5, 0.99 if run.full else 0.8):
        what = glowing_box((albedo,) * 3)
        image = run.render(what, photons=50_000 if run.full else 3_000, spp=1)
        energy = image.metadata["report"]["energy"]
        # Russian roulette keeps energy in the mean only: what is absorbed is known to 1 / sqrt(paths) of a bounce.
        run.check_share(f"power emitted at albedo {albedo}", energy["emitted"], np.pi * 24.0, 1e-4)
        run.check(f"power that escapes at albedo {albedo}", energy["escaped"], 0, 0)
    image = run.render(lit_room(), photons=2_000, spp=1, max_depth=4)
    run.check("imbalance with a limit of depth", image.metadata["report"]["energy"]["escaped"], 0, 0)


def white_furnaces(run: Run) -> None:
    """Things that absorb nothing, under a sky of 1."""
    for name, bsdf in FURNACES.items():
        camera = view((2.0, 2.5, -3.5), (0, 0, 0), 36, 24 if run.full else 12)
        image = run.render(
            scene([box()], camera, [Material(name, bsdf)], [SKY]),
            photons=0,
            caustic_photons=0,
            spp=1024 if run.full else 512,
            cells=4 if run.full else 1,
        )
        seen = image.pixels[image.layers["depth"] > 0]
        run.check(f"mean radiance, {name}", seen.mean(), 1.0, 5e-3)


def closed_furnace(run: Run) -> None:
    """Inside of a glowing ball all is equally bright; a box has edges, where estimates are biased, a ball has none."""
    albedo = 0.6
    walls = ball(1.0, around=48)
    inward = replace(walls, faces=walls.faces[:, ::-1], normals=None, emission=(1.0, 1.0, 1.0))
    material = Material("wall", Diffuse((albedo,) * 3))
    what = scene([inward], view((0.1, 0.2, -0.1), (0.5, -0.3, 1.0), 70, 16 if run.full else 8), [material])
    image = run.render(what, photons=400_000 if run.full else 40_000, spp=64 if run.full else 16, light_samples=4)
    run.check_share("radiance", image.pixels.mean(axis=(0, 1)), 1.0 / (1.0 - albedo), 0.01)


CASES = (
    HardCase(
        name="sums of 1e9 samples",
        section=8,
        shows="a pixel that adds 1e9 (small: 5e6) samples of very different brightness",
        expected="the sum by math.fsum, which rounds once",
        tolerance="1e-7: seven digits; in double 1e9 additions lose 1e-7 at the very most, 1e-12 in fact",
        measure=long_sums,
    ),
    HardCase(
        name="a pixel of many samples",
        section=8,
        shows="4 million (small: 65,536) samples of 0.1",
        expected="0.1 as a float32",
        tolerance="1e-7: seven digits",
        measure=many_samples,
    ),
    HardCase(
        name="threads, order, buckets",
        section=8,
        shows="1 to 4 threads, messages in random order",
        expected="the same image (the exactness contract)",
        tolerance="none: every bit",
        measure=threads_and_order,
    ),
    HardCase(
        name="energy ledger",
        section=8,
        shows="closed rooms of albedo 0.01, 0.5, 0.99 (small: 0.8)",
        expected="power pi Le area; all of it absorbed",
        tolerance="1e-5 of the energy; power 1e-4",
        measure=ledger,
    ),
    HardCase(
        name="white furnaces",
        section=8,
        shows="a box of each material that absorbs nothing, under a sky of 1",
        expected="1: it cannot be seen",
        tolerance="0.5 %: noise, and 0.2 % that rough microfacets hide from each other",
        measure=white_furnaces,
    ),
    HardCase(
        name="a closed furnace",
        section=8,
        shows="the inside of a glowing ball of albedo 0.6",
        expected="Le / (1 - albedo) = 2.5",
        tolerance="1 %: noise of photons and of direct light",
        measure=closed_furnace,
    ),
)
