"""`wdpm bench mitsuba`: its options, and what it does with them."""

from __future__ import annotations

import argparse
from pathlib import Path

from wdpm import values
from wdpm.bench.commands.arguments import add_counts, add_threads
from wdpm.bench.commands.benchmark import Benchmark, Measured
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.progress import Progress
from wdpm.rendering.backend import Backends

_DESCRIPTION = """\
Render a Mitsuba scene by turns with wdpm and with Mitsuba 3's path tracer, both
warm: time, ratio, and with a reference the error of both. Mitsuba finds LLVM's
library by the environment variable DRJIT_LIBLLVM_PATH where it does not itself."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add its options."""
    parser.add_argument("scene", type=Path, metavar="SCENE.xml", help="Mitsuba scene")
    parser.add_argument(
        "--reference", type=Path, metavar="FILE", help="image of the same size to measure errors against"
    )
    parser.add_argument(
        "--size", type=values.size, default=(512, 512), metavar="WxH", help="size of the images (default: 512x512)"
    )
    add_counts(
        parser,
        ("--spp", 16, "samples a pixel of wdpm"),
        ("--mitsuba-spp", 64, "samples a pixel of Mitsuba"),
        ("--photons", 250_000, "photons to be stored"),
        ("--k", 50, "photons that an estimate looks for"),
        ("--rounds", 5, "images of each"),
    )
    add_threads(parser, "threads of each")


def run(args: argparse.Namespace, backends: Backends, progress: Progress) -> Measured:
    """Time and error next to Mitsuba's."""
    from wdpm.bench import mitsuba as bench_mitsuba

    width, height = args.size
    settings = RenderSettings(integrator=Integrator.PHOTONS, spp=args.spp, photons=args.photons, k=args.k)
    setup = bench_mitsuba.Setup(args.scene, width, height, settings, args.mitsuba_spp, args.rounds)
    with backends(0) as backend:
        figures = bench_mitsuba.measure(setup, args.reference, backend, progress)
    return Measured([figures.grid()], {"mitsuba": figures.to_dict()})


BENCHMARK = Benchmark("mitsuba", "time and error next to Mitsuba 3's path tracer", _DESCRIPTION, add_arguments, run)
