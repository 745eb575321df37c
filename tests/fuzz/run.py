"""Fuzz for as long as it takes, over all cores, with the time left: rays and gathers against brute force, and the wire.

    python tests/fuzz/run.py --rays 1e8 --gathers 1e6 --messages 1e6 --seed 1
    python tests/fuzz/run.py --case traversal:1000000123     # one case again

A case is a function of its number alone, so the name and the number that a failure is reported with reproduce it. The
arrays that show it are saved as well, for when the generators have changed.
"""

from __future__ import annotations

import argparse
import importlib
import json
import multiprocessing
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from fuzz_failure import Failure

from wdpm.quiet import quiet_warp

HELPERS = Path(__file__).resolve().parents[1] / "helpers"
sys.path += [str(HELPERS), str(HELPERS / "geometry")]  # pytest has them from pyproject.toml

FUZZERS = {
    "traversal": "rays",
    "watertight": "rays",
    "routing": "rays",
    "gather": "gathers",
    "wire": "messages",
    "cells": "renders",
}
"""What each one counts; fuzz_<name>.py has run_case(number) -> (how many, failures)."""

CASES_A_SEED = 10**9
BATCH = 8
"""Cases handed to a process at once: about a second's work."""

MOST_SAVED = 50
TELL_EVERY = 5.0  # seconds


@dataclass
class Tally:
    """How far a fuzzer has come."""

    done: int = 0
    cases: int = 0
    failures: list[tuple[int, Failure]] = field(default_factory=list)


def run_batch(name: str, first: int, count: int) -> tuple[int, list[tuple[int, Failure]]]:
    """Some cases, one after another: how many rays, gathers or messages, and the failures by case."""
    quiet_warp()
    run_case = importlib.import_module(f"fuzz_{name}").run_case
    done, failures = 0, []
    for case in range(first, first + count):
        one, wrong = run_case(case)
        done += one
        failures += [(case, failure) for failure in wrong]
    return done, failures


def fuzz(name: str, wanted: int, first: int, pool: ProcessPoolExecutor, jobs: int) -> Tally:
    """Cases from `first` on until so many rays, gathers or messages are done, with a line every few seconds."""
    tally = Tally()
    start = told = time.monotonic()
    waiting: set[Future[tuple[int, list[tuple[int, Failure]]]]] = set()
    numbers: Iterator[int] = iter(range(first, first + CASES_A_SEED, BATCH))
    a_batch = 0
    while tally.done < wanted or waiting:
        while len(waiting) < 2 * jobs and tally.done + a_batch * len(waiting) < wanted:
            waiting.add(pool.submit(run_batch, name, next(numbers), BATCH))
        ready, waiting = wait(waiting, return_when=FIRST_COMPLETED)
        for future in ready:
            a_batch, failures = future.result()
            tally.done += a_batch
            tally.cases += BATCH
            tally.failures += failures
        now = time.monotonic()
        if now - told > TELL_EVERY or not waiting:
            told = now
            rate = tally.done / max(now - start, 1e-9)
            left = max(wanted - tally.done, 0) / rate
            print(
                f"{name:<11}{tally.done:>14,} of {wanted:,} {FUZZERS[name]}, {tally.cases:,} cases, {rate:,.0f}/s, "
                f"{left:,.0f} s left, {len(tally.failures)} failures",
                flush=True,
            )
    return tally


def save(folder: Path, name: str, case: int, failure: Failure, number: int) -> Path:
    """Writes a failure: what it is and how to run it again as JSON, its arrays beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{name}-{case}-{number}.json"
    again = f"python tests/fuzz/run.py --case {name}:{case}"
    file.write_text(json.dumps({"fuzzer": name, "case": case, "message": failure.message, "again": again}, indent=2))
    np.savez(file.with_suffix(".npz"), **failure.data)
    return file


def report(folder: Path, name: str, tally: Tally) -> None:
    """Tells and saves the failures of a fuzzer."""
    for number, (case, failure) in enumerate(tally.failures[:MOST_SAVED]):
        print(f"{name}:{case}: {failure.message} -> {save(folder, name, case, failure, number)}")
    if len(tally.failures) > MOST_SAVED:
        print(f"{name}: {len(tally.failures) - MOST_SAVED} more failures are not saved")


def main() -> int:
    """Returns 0 if nothing failed, else 1."""
    args = parse()
    if args.case:
        name, _, case = args.case.partition(":")
        done, failures = run_batch(name, int(case), 1)
        print(f"{name}:{case}: {done:,} {FUZZERS[name]}, {len(failures)} failures")
        report(args.output, name, Tally(done, 1, failures))
        return bool(failures)
    wanted = {name: int(getattr(args, kind)) for name, kind in FUZZERS.items()}
    first = args.seed * CASES_A_SEED
    failed = 0
    start = time.monotonic()
    for name in args.only:
        run_batch(name, first, 1)  # kernels are compiled once, not by every process
    with ProcessPoolExecutor(args.jobs, multiprocessing.get_context("spawn")) as pool:
        for name in args.only:
            tally = fuzz(name, wanted[name], first, pool, args.jobs)
            report(args.output, name, tally)
            failed += len(tally.failures)
    print(f"{failed} failures in {time.monotonic() - start:,.0f} s; seed {args.seed}")
    return bool(failed)


def parse() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rays", type=float, default=1e7, help="rays of each fuzzer of rays (default: 1e7)")
    parser.add_argument("--gathers", type=float, default=1e5, help="gathers (default: 1e5)")
    parser.add_argument("--messages", type=float, default=1e5, help="messages with something wrong (default: 1e5)")
    parser.add_argument("--renders", type=float, default=1e3, help="renders with numbers of a liar (default: 1e3)")
    parser.add_argument("--seed", type=int, default=0, help="other seeds are other cases (default: 0)")
    parser.add_argument("--only", nargs="+", choices=FUZZERS, default=list(FUZZERS), help="these fuzzers only")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes (default: all cores)")
    parser.add_argument("--case", metavar="NAME:NUMBER", help="run one case again")
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("out/fuzz"), help="folder for failures (default: out/fuzz)"
    )
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
