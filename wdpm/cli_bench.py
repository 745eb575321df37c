"""`wdpm bench`: how fast this machine is, as ratios in one run: kernels, the paper's table, effects, Mitsuba 3."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from wdpm import cli_values as values
from wdpm.cli_options import available_cores

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

    from wdpm import bench
    from wdpm.progress import make_progress

    bench.check_outputs(args.json, args.markdown)
    if getattr(args, "plot", None) is not None:
        bench.check_plot(args.plot)
    progress = make_progress()
    try:
        grids, figures = args.measure(args, progress)
    finally:
        progress.finish()
    console = Console() if sys.stdout.isatty() else Console(width=LOG_WIDTH)
    for grid in grids:
        grid.print(console)
    console.print(f"\nMeasured on {bench.machine_in_words()}.", markup=False, highlight=False)
    bench.write_outputs(grids, figures, args.json, args.markdown)
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
    parser.set_defaults(measure=_kernels)


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
    _add_threads(parser, "cores to use in all, shared out among slaves")
    parser.set_defaults(measure=_paper)


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
    parser.set_defaults(measure=_effects)


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
    parser.set_defaults(measure=_caustic)


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
    parser.set_defaults(measure=_peers)


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
    parser.set_defaults(measure=_predict)


def _predict(args: argparse.Namespace, progress: Any) -> tuple[list[Any], dict[str, Any]]:
    from wdpm import bench_predict

    figures = bench_predict.measure(
        args.scenes, progress, targets=args.errors, seeds=args.seeds, clock=args.clock, threads=args.threads
    )
    return [figures.grid()], {"predict": figures.to_dict()}


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
    parser.set_defaults(measure=_indirect)


def _add_hard_cases(benches: Any) -> None:
    parser = _add_bench(benches, "hard-cases", "scenes where renderers break, against what is right", _HARD_CASES)
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("hard-cases"), metavar="FOLDER",
        help="folder of the page (default: hard-cases)",
    )  # fmt: skip
    parser.add_argument("--only", nargs="+", default=(), metavar="TEXT", help="cases whose names contain all of these")
    parser.add_argument("--small", action="store_true", help="at the size of the tests: a minute or two")
    parser.set_defaults(measure=_hard_cases)


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
    parser.set_defaults(measure=_mitsuba)


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


def _kernels(args: argparse.Namespace, progress: Any) -> tuple[list[Any], dict[str, Any]]:
    from wdpm import bench_kernels

    figures = bench_kernels.measure(progress, bench_kernels.Load(models=tuple(args.scenes)))
    return [figures.grid()], {"kernels": figures.to_dict()}


def _paper(args: argparse.Namespace, progress: Any) -> tuple[list[Any], dict[str, Any]]:
    from wdpm import bench_paper
    from wdpm.kernels.settings import RenderSettings, Routing

    chosen = {name: getattr(args, name) for name in ("spp", "photons") if getattr(args, name) is not None}
    RenderSettings(**chosen)  # a value out of range is an error before the first scene is rendered
    routings = tuple(Routing) if args.routing == "both" else (Routing(args.routing),)
    slaves = bench_paper.DEFAULT_SLAVES if args.slaves is None else args.slaves
    scenes = [
        bench_paper.measure(scene, slaves, routings, progress, size=args.size, threads=args.threads, **chosen)
        for scene in args.scenes or bench_paper.DEFAULT_SCENES
    ]
    return [figures.grid() for figures in scenes], {"paper": [figures.to_dict() for figures in scenes]}


def _mitsuba(args: argparse.Namespace, progress: Any) -> tuple[list[Any], dict[str, Any]]:
    from wdpm import bench_mitsuba
    from wdpm.kernels.settings import RenderSettings

    width, height = args.size
    settings = RenderSettings(spp=args.spp, photons=args.photons, k=args.k)
    setup = bench_mitsuba.Setup(args.scene, width, height, settings, args.mitsuba_spp, args.rounds, args.threads)
    figures = bench_mitsuba.measure(setup, args.reference, progress)
    return [figures.grid()], {"mitsuba": figures.to_dict()}


def _effects(args: argparse.Namespace, progress: Any) -> tuple[list[Any], dict[str, Any]]:
    from wdpm import bench_effects, bench_effects_scenes
    from wdpm.bench_effects_plot import plot
    from wdpm.image_files import write_bytes
    from wdpm.kernels.settings import RenderSettings
    from wdpm.quiet import quiet_warp

    quiet_warp()
    photons = dict.fromkeys(("photons", "caustic_photons", "volume_photons"), args.photons)
    effects = bench_effects_scenes.EFFECTS
    figures = bench_effects.measure(
        progress,
        RenderSettings(spp=args.spp, **photons),
        names=[f"+ {name}" if name in effects else name for name in args.scenes],
        size=args.size,
        rounds=args.rounds,
        threads=args.threads,
        compiler=None if args.no_compile else bench_effects.compile_from_scratch,
    )
    if args.plot is not None:
        write_bytes(plot(figures).encode(), args.plot)
    return [figures.grid()], {"effects": figures.to_dict()}


def _caustic(args: argparse.Namespace, progress: Any) -> tuple[list[Any], dict[str, Any]]:
    from wdpm import bench_caustic
    from wdpm.kernels.settings import RenderSettings
    from wdpm.quiet import quiet_warp

    quiet_warp()
    names = ("spp", "photons", "caustic_photons", "caustic_k")
    settings = RenderSettings(**{name: getattr(args, name) for name in names})
    bound = bench_caustic.Bound(args.reference, args.region, args.error)
    figures = bench_caustic.measure(
        args.scene, bound, settings, args.mitsuba_spp, progress, rounds=args.rounds, threads=args.threads
    )
    return [figures.grid()], {"caustic": figures.to_dict()}


def _peers(args: argparse.Namespace, progress: Any) -> tuple[list[Any], dict[str, Any]]:
    from wdpm import bench_peers
    from wdpm.bench_peers_figures import Bounds
    from wdpm.quiet import quiet_warp
    from wdpm.scenes.errors import SettingsError

    quiet_warp()
    if args.reference is not None and len(args.scenes) > 1:
        raise SettingsError(
            f"--reference is of one scene, and there are {len(args.scenes)}: put a reference.exr beside each"
        )
    bounds = Bounds(args.errors, args.region, args.rounds, args.limit)
    pairs = [(scene, args.reference or bench_peers.default_reference(scene)) for scene in args.scenes]
    for scene, reference in pairs:
        bench_peers.check(scene, reference, bounds)
    figures = [
        bench_peers.measure(scene, reference, bounds, progress, threads=args.threads) for scene, reference in pairs
    ]
    return [each.grid() for each in figures], {"peers": [each.to_dict() for each in figures]}


def _indirect(args: argparse.Namespace, progress: Any) -> tuple[list[Any], dict[str, Any]]:
    from wdpm import bench_indirect
    from wdpm.bench_indirect_plot import plot
    from wdpm.image_files import write_bytes
    from wdpm.quiet import quiet_warp
    from wdpm.scenes.errors import SettingsError

    quiet_warp()
    if args.reference is not None and len(args.scenes) > 1:
        raise SettingsError(
            f"--reference is of one scene, and there are {len(args.scenes)}: put a reference.exr beside each"
        )
    sweep = bench_indirect.Sweep(args.spp, args.photons, args.rounds, args.region, args.reference_spp)
    pairs = [(scene, args.reference or bench_indirect.reference_beside(scene)) for scene in args.scenes]
    for scene, reference in pairs:
        if reference is not None and args.size is not None:
            raise SettingsError(f"{scene}: images have the size of {reference}; leave --size out")
    figures = [
        bench_indirect.measure(scene, reference, sweep, progress, size=args.size, threads=args.threads)
        for scene, reference in pairs
    ]
    if args.plot is not None:
        write_bytes(plot(figures).encode(), args.plot)
    grids = [grid for each in figures for grid in each.grids()]
    return grids, {"indirect": [each.to_dict() for each in figures]}


def _hard_cases(args: argparse.Namespace, progress: Any) -> tuple[list[Any], dict[str, Any]]:  # noqa: ARG001
    from wdpm import bench_hard_cases

    figures = bench_hard_cases.measure(args.output, args.only, small=args.small)
    args.code = int(figures.failed > 0)
    return [figures.grid()], {"hard_cases": figures.to_dict()}
