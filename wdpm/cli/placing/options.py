"""Options that say who places the slaves."""

from __future__ import annotations

import argparse
from pathlib import Path

from wdpm import values
from wdpm.scenes.errors import SettingsError

_PLACED = ("slurm", "dask", "hosts")
"""Options that say who places the slaves, by name in the arguments."""

_BESIDE = {"shared": ("slurm",), "remote_wdpm": ("hosts",), "join_timeout": _PLACED}
"""Options that mean something beside some of these alone."""


def add_placing_options(parser: argparse.ArgumentParser) -> None:
    """--slurm, --dask, --hosts, and what goes with them."""
    group = parser.add_argument_group("slaves elsewhere (docs/deploy.md)")
    either = group.add_mutually_exclusive_group()
    either.add_argument(
        "--slurm",
        action="store_true",
        help="as a task of srun: task 0 is the master and writes the image, the others are its slaves; cores and "
        "memory are what Slurm gives each task",
    )
    either.add_argument(
        "--dask",
        type=values.address,
        metavar="tcp://HOST:PORT",
        help="a slave on each worker of the Dask cluster with this scheduler, on --slaves of them at most; workers "
        "that come later get slaves, too",
    )
    either.add_argument(
        "--hosts",
        type=values.names,
        metavar="HOST[:N],...",
        help="a slave, or N, on each of these machines, which ssh must reach without a question",
    )
    group.add_argument(
        "--shared",
        type=Path,
        metavar="DIR",
        help="with --slurm, a directory that all nodes share, where the tasks find each other (default: this folder)",
    )
    group.add_argument(
        "--remote-wdpm",
        metavar="PATH",
        help="with --hosts, the program there (default: wdpm, found by PATH)",
    )
    group.add_argument(
        "--join-timeout",
        type=values.duration,
        metavar="TIME",
        help="with any of these, how long to wait for slaves that have not joined, like 90s or 30m, before those that "
        "have begin (default: 2m with --hosts, otherwise 10m)",
    )
    # None: nothing was asked for, and the machine or Slurm says what there is.
    parser.set_defaults(threads=None, copies=None)


def is_placed(args: argparse.Namespace) -> bool:
    """Whether something else places the slaves. Raises SettingsError for options that contradict each other."""
    asked = [name for name in _PLACED if getattr(args, name)]
    for name, of in _BESIDE.items():
        if getattr(args, name) is not None and not set(of).intersection(asked):
            those = " or ".join(f"--{each}" for each in of)
            raise SettingsError(f"--{name.replace('_', '-')} goes with {those}: give that, too, or leave it out")
    if not asked:
        return False
    for name in ("slaves", "replay"):
        if getattr(args, name) and (asked[0], name) != ("dask", "slaves"):
            raise SettingsError(f"--{asked[0]} and --{name} contradict each other; leave one of them out")
    if args.dask and (args.threads or args.memory):
        raise SettingsError(
            "--dask: Dask's workers say how many threads and how much memory; leave --threads and --memory out"
        )
    return True
