"""`wdpm accuracy`: what an error costs in time, knob by knob."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from wdpm import values
from wdpm.accuracy import knobs
from wdpm.cli import options
from wdpm.cluster.plan.copies import Copies
from wdpm.rendering.backend import Backend

_EXAMPLES = """\
examples:
  wdpm accuracy scene.xml
  wdpm accuracy scene.xml --size 256x256 --reference reference.exr
  wdpm accuracy scene.xml --sweep photons=50k..4M --sweep k=20,50,120 --sweep spp=4..256:4
  wdpm accuracy scene.xml --sweep radius=0.25x..2x --sweep passes=1,4,16 --spp 16
  wdpm accuracy scene.xml --sweep band=0..1 --sweep slaves=0,2,4
  wdpm accuracy scene.xml --predict
An interrupted sweep goes on where it stopped when the same command is given again."""


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to the parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "accuracy",
        help="measure error against time, setting by setting",
        description="Vary one setting of a render at a time, with several seeds, and measure the time and the error "
        "against a reference, split into noise and bias. Writes index.html with plots, images and the command of every "
        "point, points.csv and points.json. Settings given here are the base: a point changes one of them.",
        epilog=_EXAMPLES,
    )
    options.add_scene_options(parser)
    _add_sweep_options(parser)
    options.add_setting_options(parser)
    options.add_machine_options(parser)
    parser.add_argument_group("cluster").add_argument(
        "--slaves", type=values.count, metavar="N", help="slave processes of the base (default: 0)"
    )
    return parser


def _add_sweep_options(parser: argparse.ArgumentParser) -> None:
    sweep = parser.add_argument_group("sweep")
    sweep.add_argument(
        "--sweep",
        type=knobs.parse_sweep,
        action="append",
        default=[],
        metavar="SETTING=VALUES",
        help="values of one setting: a list (20,50,120), a range (50k..4M), or one with its number of steps "
        "(50k..4M:7); radii also as factors (0.5x..2x). Settings: "
        + ", ".join(knob.option for knob in knobs.KNOBS)
        + " (default: within the budget, all that matter to the scene, except "
        + ", ".join(knob.option for knob in knobs.KNOBS if not knob.by_default)
        + ")",
    )
    sweep.add_argument(
        "--seeds",
        type=values.positive_count,
        metavar="N",
        help="seeds of each point, 3 or more (default: 3)",
    )
    sweep.add_argument(
        "--budget",
        type=values.duration,
        metavar="TIME",
        help="time for the default sweep, like 90s or 5m; two fifths of it are for the reference (default: 5m)",
    )
    sweep.add_argument(
        "--reference",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="image to compare with; given twice, two independent ones, from which the noise of the reference is known "
        "(default: wdpm's own path tracer renders one)",
    )
    sweep.add_argument(
        "--reference-time",
        type=values.duration,
        metavar="TIME",
        help="time to render the reference, if none is given (default: two fifths of the budget)",
    )
    sweep.add_argument(
        "--clock",
        choices=knobs.CLOCKS,
        metavar="WHICH",
        help="time of a point: wall, or cpu (of all cores together), which depends less on other work on the machine "
        "(default: wall)",
    )
    sweep.add_argument(
        "--trim",
        type=values.length,
        metavar="SHARE",
        help="leave this share of the pixels, those with the largest errors over all points, out of the errors, like "
        "0.001 (default: 0)",
    )
    sweep.add_argument(
        "-o", "--output", type=Path, metavar="FOLDER", help="folder of the results (default: accuracy-SCENE)"
    )
    sweep.add_argument(
        "--predict",
        action="store_true",
        help="no sweep: predict from a short pilot how long --until-error takes for relMSE 0.1 to 0.005",
    )
    sweep.add_argument("-q", "--quiet", action="store_true", help="show no progress")


def run(args: argparse.Namespace) -> int:
    """Measure, write the results and print them; returns the exit code."""
    if args.predict:
        from wdpm.cli.predict import predict_and_print

        return predict_and_print(args)
    from rich.console import Console

    from wdpm.accuracy.run import Request, measure
    from wdpm.accuracy.table import print_accuracy
    from wdpm.cli.result import default_output
    from wdpm.local_backend import backend_here
    from wdpm.progress import make_progress
    from wdpm.quiet import quiet_warp

    quiet_warp()
    folder = args.output or Path(f"accuracy-{default_output(args.scene).stem}")
    # None is what was not typed (--predict must know); Request has the defaults.
    typed = {name: getattr(args, name) for name in ("slaves", "seeds", "budget", "reference_time", "clock", "trim")}
    request = Request(
        scene=args.scene,
        definitions=tuple(args.definitions),
        size=args.size,
        chosen=options.chosen_settings(args),
        sweeps=tuple(args.sweep),
        references=tuple(args.reference),
        folder=folder,
        lenient=args.lenient,
        **{name: value for name, value in typed.items() if value is not None},
    )
    progress = make_progress(args.quiet)
    try:

        def backends(slaves: int) -> Backend:
            # Without copies: what a cut through the map costs (`band`) shows only where the scene is cut.
            return backend_here(slaves, args.threads, args.device, Copies.NONE)

        found = measure(request, backends, progress)
    finally:
        progress.finish()
    print_accuracy(found, Console())
    print(f"wrote {folder / 'index.html'}, points.csv and points.json, and all images")
    return 0
