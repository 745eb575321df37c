"""`wdpm bench effects`: its options, and what it does with them."""

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
Render the Cornell box with one effect more at a time, and with all of them. Each
scene is rendered by kernels compiled for its effects and by kernels with all
effects: time, compile time, kernel modules, and whether the bits are equal."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add its options."""
    parser.add_argument(
        "scenes", nargs="*", metavar="SCENE", help="only these, such as mirror or everything (default: all)"
    )
    parser.add_argument("--plot", type=Path, metavar="FILE.svg", help="also draw a bar for each effect")
    parser.add_argument(
        "--no-compile", action="store_true", help="do not measure compile times, which takes some minutes"
    )
    parser.add_argument(
        "--size", type=values.size, default=(256, 256), metavar="WxH", help="size of the images (default: 256x256)"
    )
    add_counts(
        parser,
        ("--spp", 4, "samples a pixel"),
        ("--photons", 100_000, "photons to store in each map"),
        ("--rounds", 3, "images of each scene by each kind of kernels"),
    )
    add_threads(parser, "threads to render with")


def run(args: argparse.Namespace, backends: Backends, progress: Progress) -> Measured:
    """What each effect costs."""
    from wdpm.bench import effects as bench_effects
    from wdpm.bench import effects_scenes
    from wdpm.bench.effects_plot import plot
    from wdpm.images.files import write_bytes

    photons = dict.fromkeys(("photons", "caustic_photons", "volume_photons"), args.photons)
    effects = effects_scenes.EFFECTS
    with backends(0) as backend:
        figures = bench_effects.measure(
            RenderSettings(integrator=Integrator.PHOTONS, spp=args.spp, **photons),
            backend,
            progress,
            names=[f"+ {name}" if name in effects else name for name in args.scenes],
            size=args.size,
            rounds=args.rounds,
            compiler=None if args.no_compile else bench_effects.compile_from_scratch,
        )
    if args.plot is not None:
        write_bytes(plot(figures).encode(), args.plot)
    return Measured([figures.grid()], {"effects": figures.to_dict()})


BENCHMARK = Benchmark(
    "effects", "what each effect costs a scene that uses it, and one that does not", _DESCRIPTION, add_arguments, run
)
