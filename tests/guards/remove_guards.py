#!/usr/bin/env python
"""Takes away one guard after another, in a copy of the repository, and demands that the tests named for it fail.

    python tests/guards/remove_guards.py                  # all; kernels compile anew for each: an hour on two cores
    python tests/guards/remove_guards.py --only tie pad   # guards whose names contain one of these
    python tests/guards/remove_guards.py --table          # print the table for docs/hard-cases.md

Exit code 0 if every test that was run failed as it should, else 1.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

from guard import ROOT, Guard, every_guard, guards_by_subject

COPIED = ("kernels", "cluster", "scenes", "wdpm", "tests", "pyproject.toml")
"""What a copy needs. The packages in wdpm/ are links, and stay links to the copy's own folders."""

TIMEOUT = 600
"""Seconds for all tests of a guard, compiling included: without some guards a loop has no end."""

MOST_SHOWN = 110
"""Characters of an error."""


@dataclass(frozen=True)
class Removal:
    """What became of the tests of a guard without it.

    Attributes:
        silent: tests that passed all the same.
        broken: why nothing can be said, such as a text that is not there any more; "" if it can.
        how: the first line of the first failure.
    """

    guard: Guard
    silent: tuple[str, ...]
    broken: str
    how: str
    seconds: float

    @property
    def noticed(self) -> bool:
        """Whether every test failed."""
        return not self.silent and not self.broken


def main() -> int:
    """Runs what is asked for."""
    args = _parse()
    if args.table:
        print(table())
        return 0
    chosen = [guard for guard in every_guard() if not args.only or any(text in guard.name for text in args.only)]
    bad = 0
    with tempfile.TemporaryDirectory(prefix="guards-") as folder, ThreadPoolExecutor(args.jobs) as pool:
        copies: SimpleQueue[Path] = SimpleQueue()
        for number in range(args.jobs):
            copies.put(_copy(Path(folder) / str(number)))
        for number, removal in enumerate(pool.map(lambda guard: remove(guard, copies), chosen), start=1):
            bad += not removal.noticed
            said = "noticed" if removal.noticed else "NOT NOTICED"
            print(f"{number:>3}/{len(chosen)} {said:<11} {removal.seconds:5.0f} s  {removal.guard.name}", flush=True)
            for line in [removal.broken, *(f"passes: {test}" for test in removal.silent), removal.how]:
                if line:
                    print(f"{'':>29}{line[:MOST_SHOWN]}", flush=True)
    print(f"{len(chosen) - bad} of {len(chosen)} guards: a test fails without them")
    return bool(bad)


def remove(guard: Guard, copies: SimpleQueue[Path]) -> Removal:
    """Run a guard's tests without it, in one of the copies."""
    copy = copies.get()
    began = time.perf_counter()
    source = (copy / guard.file).read_text(encoding="utf-8")
    try:
        (copy / guard.file).write_text(guard.removed_from(source), encoding="utf-8")
        silent, broken, how = _run_tests(guard.tests, copy)
    except ValueError as error:
        silent, broken, how = (), str(error), ""
    finally:
        (copy / guard.file).write_text(source, encoding="utf-8")
        copies.put(copy)
    return Removal(guard, silent, broken, how, time.perf_counter() - began)


def _run_tests(tests: tuple[str, ...], copy: Path) -> tuple[tuple[str, ...], str, str]:
    """Tests that pass, why it cannot be told, and the first error."""
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "--no-header",
        "--tb=line",
        "-rA",
        "-p",
        "no:cacheprovider",
        *tests,
    ]
    environment = {**os.environ, "PYTHONPATH": str(copy), "HYPOTHESIS_PROFILE": "unshrunk"}
    try:
        done = subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True, timeout=TIMEOUT)
    except subprocess.TimeoutExpired:
        return (), "", f"no end within {TIMEOUT} s"
    lines = done.stdout.splitlines()
    failed = [line for line in lines if line.startswith(("FAILED ", "ERROR "))]
    uncollected = [line for line in failed if "::" not in line]
    passed = {line.removeprefix("PASSED ") for line in lines if line.startswith("PASSED ")}
    if uncollected or done.returncode > 1:
        return (), f"pytest ended with {done.returncode}: {[*uncollected, *lines, *done.stderr.splitlines()][-1]}", ""
    if done.returncode < 0:
        return (), "", f"the process died of signal {-done.returncode}"
    how = failed[0].partition(" - ")[2] if failed else ""
    return (
        tuple(test for test in tests if not any(test in line for line in failed) and _all_passed(test, passed)),
        "",
        how,
    )


def _all_passed(test: str, passed: set[str]) -> bool:
    """Whether a test passed, in all of its parameters."""
    return any(name == test or name.startswith(test + "[") for name in passed)


def table() -> str:
    """All guards as Markdown."""
    lines: list[str] = []
    for title, guards in guards_by_subject().items():
        lines += [f"### {title}", "", "| guard | where | without it | test that fails |", "| --- | --- | --- | --- |"]
        for guard in guards:
            where = f"[{guard.file}](../{guard.file})"
            tests = ", ".join(f"`{test.rpartition('::')[2]}`" for test in guard.tests)
            lines.append(f"| {guard.name} | {where} | {guard.prevents} | {tests} |")
        lines.append("")
    return "\n".join(lines).rstrip()


def _copy(to: Path) -> Path:
    to.mkdir()
    skip = shutil.ignore_patterns("__pycache__")
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, to / name, symlinks=True, ignore=skip)
        else:
            shutil.copy(ROOT / name, to / name)
    return to


def _parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[], metavar="TEXT", help="guards whose names contain one of these")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="at a time (default: cores)")
    parser.add_argument("--table", action="store_true", help="print the table of all guards as Markdown")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
