"""`wdpm bench caustic`: its options, and what it does with them."""

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
Time that wdpm and Mitsuba 3's path tracer take until the error in a region of
the image, such as a caustic, is below a bound, both warm and by turns. Mitsuba's
error at the time that is asked for follows from a measured one: it falls with the
number of samples. LLVM's library: see wdpm bench mitsuba --help."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add its options."""
    parser.add_argument("scene", type=Path, metavar="SCENE.xml", help="Mitsuba scene")
    parser.add_argument(
        "--reference", type=Path, metavar="FILE", required=True, help="image to measure errors against; sets the size"
    )
    parser.add_argument(
        "--region", type=values.region, metavar="L,T,R,B", help="pixels that count (default: the whole image)"
    )
    parser.add_argument(
        "--error", type=values.length, default=0.02, metavar="RELMSE", help="bound of the relMSE (default: 0.02)"
    )
    add_counts(
        parser,
        ("--spp", 6, "samples a pixel of wdpm"),
        ("--photons", 50_000, "photons to be stored in the global map"),
        ("--caustic-photons", 100_000, "photons to be stored in the caustic map"),
        ("--caustic-k", 20, "photons that an estimate from the caustic map looks for"),
        ("--mitsuba-spp", 256, "samples a pixel of Mitsuba that its error is measured at"),
        ("--rounds", 3, "images of each"),
    )
    add_threads(parser, "threads of each")


def run(args: argparse.Namespace, backends: Backends, progress: Progress) -> Measured:
    """Time to an error in a region, next to Mitsuba's."""
    from wdpm.bench import caustic as bench_caustic

    names = ("spp", "photons", "caustic_photons", "caustic_k")
    settings = RenderSettings(integrator=Integrator.PHOTONS, **{name: getattr(args, name) for name in names})
    bound = bench_caustic.Bound(args.reference, args.region, args.error)
    with backends(0) as backend:
        figures = bench_caustic.measure(
            args.scene, bound, settings, args.mitsuba_spp, backend, progress, rounds=args.rounds
        )
    return Measured([figures.grid()], {"caustic": figures.to_dict()})


BENCHMARK = Benchmark(
    "caustic", "time to an error in a region, next to Mitsuba 3's path tracer", _DESCRIPTION, add_arguments, run
)
