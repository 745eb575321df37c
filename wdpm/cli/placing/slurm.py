"""`wdpm slurm`: write a job script."""

from __future__ import annotations

import argparse
import re
from typing import Any

from wdpm import values
from wdpm.cli.placing.options import is_placed
from wdpm.scenes.errors import SettingsError

_EXAMPLES = """\
examples:
  wdpm slurm --tasks 9 --cores 8 --time 4:00:00 scene.xml -o scene.exr --spp 256 --passes 16 > job.sh
  sbatch job.sh"""


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to the parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "slurm",
        help="write a job script for Slurm",
        description="Write a job script for Slurm to standard output. Its job goes on without slaves that are lost, is "
        "requeued when its time is over or the master is lost, and goes on from what is kept then.",
        usage="wdpm slurm [OPTIONS OF THE JOB] SCENE [OPTIONS OF wdpm render]",
        epilog=_EXAMPLES,
    )
    parser.add_argument(
        "--tasks",
        type=values.positive_count,
        required=True,
        metavar="N",
        help="tasks of the job: a master, and N - 1 slaves",
    )
    parser.add_argument("--cores", type=values.positive_count, default=1, metavar="N", help="of each task (default: 1)")
    parser.add_argument(
        "--memory-per-core",
        type=values.memory,
        metavar="SIZE",
        help="of each core of each task, like 2G (default: the partition's)",
    )
    parser.add_argument(
        "--time", type=_time, metavar="TIME", help="limit of a run, like 90 (minutes), 4:00:00 or 2-12 (days-hours)"
    )
    parser.add_argument("--partition", type=_word, metavar="NAME", help="default: Slurm's")
    parser.add_argument(
        "--wdpm", default="wdpm", metavar="PATH", help="the program on the nodes (default: wdpm, found by PATH)"
    )
    parser.set_defaults(render_parser=subparsers.choices["render"])  # knows what it may be given
    parser.add_argument("words", nargs=argparse.REMAINDER, metavar="SCENE ...", help="what `wdpm render` is given")
    return parser


def run(args: argparse.Namespace) -> int:
    """Write the script; returns the exit code."""
    from wdpm.cli.result import first_output
    from wdpm.placing.job_script import Job, job_script

    if args.tasks < 2:
        raise SettingsError("--tasks 1: a master needs at least one slave; ask for 2 or more")
    words = [*args.words, "--slurm"]
    rendered = args.render_parser.parse_args(words)
    is_placed(rendered)  # checks that nothing contradicts --slurm
    if rendered.frames is not None:
        raise SettingsError(
            "wdpm slurm: its scripts are for one image; for --frames, write one that runs "
            "srun wdpm render SCENE --frames A..B --slurm --resume"
        )
    image = first_output(rendered)
    job = Job(
        name=f"wdpm-{re.sub(r'[^A-Za-z0-9_.-]', '-', image.stem)}",
        tasks=args.tasks,
        cores=args.cores,
        memory=args.memory_per_core,
        time=args.time,
        partition=args.partition,
    )
    if rendered.resume:
        raise SettingsError("wdpm slurm: leave --resume out; the script gives it when there is something to resume")
    print(job_script(job, [args.wdpm, "render", *words], image), end="")
    return 0


def _time(text: str) -> str:
    if re.fullmatch(r"\d+|\d+:\d\d(:\d\d)?|\d+-\d+(:\d\d){0,2}", text) is None:
        raise argparse.ArgumentTypeError(f"'{text}' is no time of Slurm's: expected 90 (minutes), 4:00:00 or 2-12")
    return text


def _word(text: str) -> str:
    if re.fullmatch(r"[\w.,-]+", text) is None:
        raise argparse.ArgumentTypeError(f"'{text}' is no name of a partition")
    return text
