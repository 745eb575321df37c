"""`wdpm bench`: how fast this machine is, as ratios in one run: kernels, the paper's table, effects, Mitsuba 3.

What each benchmark takes; what it does with it is in bench_measures.py.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from wdpm import values
from wdpm.cli import bench_measures as measures
from wdpm.cluster.settings import Indirect
from wdpm.devices import available_cores
from wdpm.report.grid import machine_in_words

_EXAMPLES = """\
examples:
  wdpm bench kernels
  wdpm bench paper scene.xml --slaves 0,2,4 --routing both --markdown table.md
  wdpm bench effects --plot effects.svg
  wdpm bench mitsuba scene.xml --reference reference.exr
  wdpm bench caustic glass.xml --reference reference.exr --region 136,222,226,250
  wdpm bench indirect cbox/scene.xml --plot indirect.svg
  wdpm bench hard-cases --only furnace -o out/hard-cases
  wdpm bench peers sibenik/scene.xml sponza/scene.xml --errors 0.05,0.02,0.01,0.005

wdpm bench WHAT --help says more. The libraries compared with come with: pip install 'wdpm[peers,test]'"""

_KERNELS = """\
Measure one core of this machine in one process: rays against Embree, nearest
photons against SciPy's cKDTree, and how many photons are traced a second.
Times to compile are apart. What is not installed is left out, and said so."""

_PAPER = """\
Render scenes without slaves and with clusters of slaves on this machine: time
and speed-up, photons and triangles that each slave holds as shares of all, what
is sent, and the error against the image without slaves (it should be none)."""

_EFFECTS = """\
Render the Cornell box with one effect after the other, and with all, each by
kernels for just what the scene calls for and by kernels that have all effects
compiled in: time, compile time, kernel modules, and whether the bits are equal."""

_CAUSTIC = """\
Time that wdpm and Mitsuba 3's path tracer take until the error in a region of
the image, such as a caustic, is below a bound, both warm and by turns. Mitsuba's
error at the time that is asked for follows from a measured one: it falls with the
number of samples. LLVM's library: see wdpm bench mitsuba --help."""

_MITSUBA = """\
Render a Mitsuba scene by turns with wdpm and with Mitsuba 3's path tracer, both
warm: time, ratio, and with a reference the error of both. Mitsuba finds LLVM's
library by the environment variable DRJIT_LIBLLVM_PATH where it does not itself."""

_PEERS = """\
Time that wdpm and Mitsuba 3's path tracer take to errors of the whole image, both
warm, at the size of each scene's reference. wdpm: the fastest of a fixed grid of
settings, the same for all scenes. Mitsuba: measured at some numbers of samples,
and error = a / samples between and beyond. LLVM's library: see wdpm bench mitsuba
--help. CPU time is that of all threads: what else runs hardly changes it."""

_INDIRECT = """\
Render scenes with indirect light from the photon map, by final gathering and by
the irradiance cache, by turns and warm, at numbers of samples and of photons:
error against time. Errors are against reference.exr beside the scene, whose size
the images then have, or against path tracing of our own."""

_HARD_CASES = """\
Run the suite of hard cases in full: scenes where renderers break, each against an
expectation that does not come from wdpm. Writes a page with a row a case: picture,
expected, measured, tolerance, verdict, time. Exit code 1 if one fails. The suite
is in the repository, and not in an installed package."""

_PREDICT = """\
Ask scenes for errors, as --until-error does, and hold what it says against a
reference image and the clock: true error against the one asked for and the one
estimated, time taken against time predicted."""

ROUTINGS = ("forward", "merge", "both")

LOG_WIDTH = 120
"""Columns of the tables where there is no terminal that says how many it has."""


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to the parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "bench",
        help="how fast this machine is",
        description="Measure this machine, as ratios in one run.",
        epilog=_EXAMPLES,
    )
    benches = parser.add_subparsers(title="benchmarks", metavar="WHAT", required=True)
    _add_kernels(benches)
    _add_paper(benches)
    _add_effects(benches)
    _add_mitsuba(benches)
    _add_caustic(benches)
    _add_peers(benches)
    _add_indirect(benches)
    _add_hard_cases(benches)
    _add_predict(benches)
    return parser


def run(args: argparse.Namespace) -> int:
    """Measure, print and write; returns the exit code."""
    from rich.console import Console

    from wdpm.bench import outputs
    from wdpm.progress import make_progress
    from wdpm.quiet import quiet_warp

    quiet_warp()
    outputs.check_outputs(args.json, args.markdown)
    if getattr(args, "plot", None) is not None:
        outputs.check_plot(args.plot)
    progress = make_progress()
    try:
        grids, figures = args.measure(args, progress)
    finally:
        progress.finish()
    console = Console() if sys.stdout.isatty() else Console(width=LOG_WIDTH)
    for grid in grids:
        grid.print(console)
    console.print(f"\nMeasured on {machine_in_words()}.", markup=False, highlight=False)
    outputs.write_outputs(grids, figures, args.json, args.markdown)
    return int(getattr(args, "code", 0))


def slave_counts(text: str) -> tuple[int, ...]:
    """`0,2,4` to numbers of slaves, each once."""
    return tuple(dict.fromkeys(values.count(part) for part in text.split(",")))


def counts(text: str) -> tuple[int, ...]:
    """`4,8,16` to numbers above 0, each once."""
    return tuple(dict.fromkeys(values.positive_count(part) for part in text.split(",")))


def relative_errors(text: str) -> tuple[float, ...]:
    """`0.05,0.01` to error bounds; their range is for the benchmark to check."""
    return tuple(values.length(part) for part in text.split(","))


def _add_kernels(benches: Any) -> None:
    parser = _add_bench(benches, "kernels", "ray traversal, photon gathers and photon tracing on one core", _KERNELS)
    parser.add_argument(
        "scenes", nargs="*", metavar="SCENE", help="scenes to trace rays in, besides a bumpy ball in a room"
    )
    parser.set_defaults(measure=measures.kernels)


def _add_paper(benches: Any) -> None:
    parser = _add_bench(benches, "paper", "what a cluster holds, sends and costs", _PAPER)
    parser.add_argument(
        "scenes",
        nargs="*",
        metavar="SCENE",
        help="scene files or built-in scenes (default: cornell-box and atrium:100k)",
    )
    parser.add_argument(
        "--slaves",
        type=slave_counts,
        metavar="N,N,...",
        help="numbers of slaves; the render without slaves is always made (default: 0,2,4)",
    )
    parser.add_argument(
        "--routing",
        choices=ROUTINGS,
        default="forward",
        metavar="HOW",
        help="forward, merge or both (default: forward)",
    )
    parser.add_argument("--size", type=values.size, metavar="WxH", help="size of the images (default: the scene's)")
    parser.add_argument(
        "--spp", type=values.positive_count, metavar="N", help="samples a pixel (default: the scene's, or 16)"
    )
    parser.add_argument("--photons", type=values.count, metavar="N", help="photons to be stored (default: 250k)")
    parser.add_argument(
        "--indirect",
        choices=[kind.value for kind in Indirect],
        default=Indirect.MAP.value,
        metavar="HOW",
        help="where indirect light comes from, see wdpm render --help (default: map, as in the paper)",
    )
    _add_threads(parser, "cores to use in all, shared out among slaves")
    parser.set_defaults(measure=measures.paper)


def _add_effects(benches: Any) -> None:
    parser = _add_bench(benches, "effects", "what each effect costs, where it is called for and where not", _EFFECTS)
    parser.add_argument(
        "scenes", nargs="*", metavar="SCENE", help="of these, such as mirror or everything (default: all)"
    )
    parser.add_argument("--plot", type=Path, metavar="FILE.svg", help="also draw a bar for each effect")
    parser.add_argument(
        "--no-compile", action="store_true", help="do not measure compile times, which takes some minutes"
    )
    parser.add_argument(
        "--size", type=values.size, default=(256, 256), metavar="WxH", help="size of the images (default: 256x256)"
    )
    _add_counts(
        parser,
        ("--spp", 4, "samples a pixel"),
        ("--photons", 100_000, "photons to be stored in each map"),
        ("--rounds", 3, "images of each scene with either kernels"),
    )
    _add_threads(parser, "threads to render with")
    parser.set_defaults(measure=measures.effects)


def _add_caustic(benches: Any) -> None:
    parser = _add_bench(benches, "caustic", "time to an error in a region, next to Mitsuba 3's path tracer", _CAUSTIC)
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
    _add_counts(
        parser,
        ("--spp", 6, "samples a pixel of wdpm"),
        ("--photons", 50_000, "photons to be stored in the global map"),
        ("--caustic-photons", 100_000, "photons to be stored in the caustic map"),
        ("--caustic-k", 20, "photons that an estimate from the caustic map looks for"),
        ("--mitsuba-spp", 256, "samples a pixel of Mitsuba that its error is measured at"),
        ("--rounds", 3, "images of each"),
    )
    _add_threads(parser, "threads of each")
    parser.set_defaults(measure=measures.caustic)


def _add_peers(benches: Any) -> None:
    parser = _add_bench(benches, "peers", "time to an error, next to Mitsuba 3's path tracer", _PEERS)
    parser.add_argument("scenes", nargs="+", type=Path, metavar="SCENE.xml", help="Mitsuba scenes")
    parser.add_argument(
        "--reference", type=Path, metavar="FILE", help="of a single scene (default: reference.exr beside each scene)"
    )
    parser.add_argument(
        "--errors",
        type=relative_errors,
        default=(0.05, 0.02, 0.01, 0.005),
        metavar="E,E,...",
        help="bounds of the relMSE (default: 0.05,0.02,0.01,0.005)",
    )
    parser.add_argument(
        "--region", type=values.region, metavar="L,T,R,B", help="pixels that count (default: the whole image)"
    )
    parser.add_argument(
        "--limit",
        type=values.length,
        default=60.0,
        metavar="SECONDS",
        help="try nothing that is bound to take longer (default: 60)",
    )
    _add_counts(parser, ("--rounds", 2, "images that confirm a choice of settings"))
    _add_threads(parser, "threads of each")
    parser.set_defaults(measure=measures.peers)


def _add_predict(benches: Any) -> None:
    parser = _add_bench(benches, "predict", "how true it is what --until-error predicts and estimates", _PREDICT)
    parser.add_argument(
        "scenes", nargs="+", type=Path, metavar="SCENE", help="scene files, each with a reference.exr beside it"
    )
    parser.add_argument(
        "--errors",
        type=relative_errors,
        default=(0.1, 0.05, 0.02, 0.01),
        metavar="E,E,...",
        help="relMSE to ask for (default: 0.1,0.05,0.02,0.01)",
    )
    parser.add_argument(
        "--clock",
        choices=("cpu", "wall"),
        default="cpu",
        help="time to predict: of all threads together, or on the wall (default: cpu, which other work on the machine "
        "does not lengthen)",
    )
    _add_counts(parser, ("--seeds", 1, "runs of each error"))
    _add_threads(parser, "threads to render with")
    parser.set_defaults(measure=measures.predict)


def _add_indirect(benches: Any) -> None:
    parser = _add_bench(benches, "indirect", "photon map, final gather and irradiance cache side by side", _INDIRECT)
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
    _add_counts(
        parser,
        ("--reference-spp", 1024, "samples a pixel of a reference that is path traced"),
        ("--rounds", 2, "images of each"),
    )
    _add_threads(parser, "threads to render with")
    parser.add_argument("--plot", type=Path, metavar="FILE.svg", help="also write a plot of error against time")
    parser.set_defaults(measure=measures.indirect)


def _add_hard_cases(benches: Any) -> None:
    parser = _add_bench(benches, "hard-cases", "scenes where renderers break, against what is right", _HARD_CASES)
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("hard-cases"), metavar="FOLDER",
        help="folder of the page (default: hard-cases)",
    )  # fmt: skip
    parser.add_argument("--only", nargs="+", default=(), metavar="TEXT", help="cases whose names contain all of these")
    parser.add_argument("--small", action="store_true", help="at the size of the tests: a minute or two")
    parser.set_defaults(measure=measures.hard_cases)


def _add_counts(parser: argparse.ArgumentParser, *rows: tuple[str, int, str]) -> None:
    for flag, default, text in rows:
        parser.add_argument(
            flag, type=values.positive_count, default=default, metavar="N", help=f"{text} (default: {default:,})"
        )


def _add_mitsuba(benches: Any) -> None:
    parser = _add_bench(benches, "mitsuba", "time and error next to Mitsuba 3's path tracer", _MITSUBA)
    parser.add_argument("scene", type=Path, metavar="SCENE.xml", help="Mitsuba scene")
    parser.add_argument(
        "--reference", type=Path, metavar="FILE", help="image of the same size to measure errors against"
    )
    parser.add_argument(
        "--size", type=values.size, default=(512, 512), metavar="WxH", help="size of the images (default: 512x512)"
    )
    _add_counts(
        parser,
        ("--spp", 16, "samples a pixel of wdpm"),
        ("--mitsuba-spp", 64, "samples a pixel of Mitsuba"),
        ("--photons", 250_000, "photons to be stored"),
        ("--k", 50, "photons that an estimate looks for"),
        ("--rounds", 5, "images of each"),
    )
    _add_threads(parser, "threads of each")
    parser.set_defaults(measure=measures.mitsuba)


def _add_bench(benches: Any, name: str, text: str, description: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = benches.add_parser(
        name, help=text, description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, metavar="FILE.json", help="also write all figures as JSON")
    parser.add_argument("--markdown", type=Path, metavar="FILE.md", help="also write the tables as Markdown")
    return parser


def _add_threads(parser: argparse.ArgumentParser, text: str) -> None:
    parser.add_argument(
        "--threads",
        type=values.positive_count,
        default=available_cores(),
        metavar="N",
        help=f"{text} (default: all cores)",
    )
