"""Section 8: sums of very many samples, and energy. (Order and threads: tests/property; furnaces: tests/analytic.)"""

from __future__ import annotations

import math

import numpy as np
import warp as wp
from case import Run, hard_case
from rooms import glowing_box, lit_room

from wdpm.kernels import columns
from wdpm.kernels.camera import add_samples

WAVE = 1_000_000


@hard_case(
    "sums of 1e9 samples",
    section=8,
    shows="a pixel that adds 1e9 (small: 5e6) samples of very different brightness",
    expected="the sum by math.fsum, which rounds once",
    tolerance="1e-7: seven digits; in double 1e9 additions lose 1e-7 at the very most, 1e-12 in fact",
)
def long_sums(run: Run) -> None:
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


@hard_case(
    "a pixel of many samples",
    section=8,
    shows="4 million (small: 65,536) samples of 0.1",
    expected="0.1 as a float32",
    tolerance="1e-7: seven digits",
)
def many_samples(run: Run) -> None:
    radiance = float(np.float32(0.1))
    what = glowing_box((0.0, 0.0, 0.0), (radiance,) * 3, size=1)
    spp = 1 << (22 if run.full else 16)
    image = run.render(what, photons=0, spp=spp, cells=1)
    run.check_share(f"radiance, {spp:,} samples", image.pixels, radiance, 1e-7)


@hard_case(
    "energy ledger",
    section=8,
    shows="closed rooms of albedo 0.01, 0.5, 0.99 (small: 0.8)",
    expected="power pi Le area; all of it absorbed",
    tolerance="1e-5 of the energy; power 1e-4",
)
def ledger(run: Run) -> None:
    for albedo in (0.01, 0.5, 0.99 if run.full else 0.8):
        what = glowing_box((albedo,) * 3)
        image = run.render(what, photons=50_000 if run.full else 3_000, spp=1)
        energy = image.metadata["report"]["energy"]
        # Russian roulette keeps energy in the mean only: what is absorbed is known to 1 / sqrt(paths) of a bounce.
        run.check_share(f"power emitted at albedo {albedo}", energy["emitted"], np.pi * 24.0, 1e-4)
        run.check(f"power that escapes at albedo {albedo}", energy["escaped"], 0, 0)
    image = run.render(lit_room(), photons=2_000, spp=1, max_depth=4)
    run.check("imbalance with a limit of depth", image.metadata["report"]["energy"]["escaped"], 0, 0)
