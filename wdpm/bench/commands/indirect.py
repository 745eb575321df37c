"""`wdpm bench indirect`: its options, and what it does with them."""

from __future__ import annotations

import argparse
from pathlib import Path

from wdpm import values
from wdpm.bench.commands.arguments import add_counts, add_threads, check_one_reference, counts, find_all
from wdpm.bench.commands.benchmark import Benchmark, Measured
from wdpm.progress import Progress
from wdpm.rendering.backend import Backends
from wdpm.scenes.errors import SettingsError

_DESCRIPTION = """\
Render scenes with indirect light from the photon map, by final gathering and by
the irradiance cache, by turns and warm, at numbers of samples and of photons:
error against time. Errors are against reference.exr beside the scene, whose size
the images then have, or against path tracing of our own."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add its options."""
    parser.add_argument(
        "scenes",
        nargs="*",
        default=("cornell-box",),
        metavar="SCENE",
        help="scene files, or names of built-in scenes (default: cornell-box)",
    )
    parser.add_argument("--reference", type=Path, metavar="FILE", help="of a single scene: measure errors against it")
    parser.add_argument(
        "--size", type=values.size, metavar="WxH", help="of images without a reference file (default: the scene's own)"
    )
    parser.add_argument(
        "--spp", type=counts, default=(4, 8, 16, 32, 64), metavar="N,N,...",
        help="samples a pixel (default: 4,8,16,32,64)",
    )  # fmt: skip
    parser.add_argument(
        "--photons", type=counts, default=(50_000, 250_000), metavar="N,N,...",
        help="photons to be stored (default: 50000,250000)",
    )  # fmt: skip
    parser.add_argument(
        "--region", type=values.region, metavar="L,T,R,B", help="pixels whose error counts (default: the whole image)"
    )
    add_counts(
        parser,
        ("--reference-spp", 1024, "samples a pixel of a reference that is path traced"),
        ("--rounds", 2, "images of each"),
    )
    add_threads(parser, "threads to render with")
    parser.add_argument("--plot", type=Path, metavar="FILE.svg", help="also write a plot of error against time")


def run(args: argparse.Namespace, backends: Backends, progress: Progress) -> Measured:
    """Photon map, final gathering and irradiance cache side by side."""
    from wdpm.bench import indirect as bench_indirect
    from wdpm.bench.indirect_plot import plot
    from wdpm.images.files import write_bytes

    check_one_reference(args.reference, args.scenes)
    find_all(args.scenes)
    sweep = bench_indirect.Sweep(args.spp, args.photons, args.rounds, args.region, args.reference_spp)
    pairs = [(scene, args.reference or bench_indirect.reference_beside(scene)) for scene in args.scenes]
    for scene, reference in pairs:
        if reference is not None and args.size is not None:
            raise SettingsError(f"{scene}: images have the size of {reference}; leave --size out")
    with backends(0) as backend:
        figures = [
            bench_indirect.measure(scene, reference, sweep, backend, progress, size=args.size)
            for scene, reference in pairs
        ]
    if args.plot is not None:
        write_bytes(plot(figures).encode(), args.plot)
    grids = [grid for each in figures for grid in each.grids()]
    return Measured(grids, {"indirect": [each.to_dict() for each in figures]})


BENCHMARK = Benchmark(
    "indirect", "photon map, final gather and irradiance cache side by side", _DESCRIPTION, add_arguments, run
)
