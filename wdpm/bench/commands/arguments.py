"""Options that several benchmarks have, and what their values look like."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from wdpm import values
from wdpm.devices import available_cores

if TYPE_CHECKING:
    from wdpm.bench.rows import Rows


def slave_counts(text: str) -> tuple[int, ...]:
    """`0,2,4` to numbers of slaves, each once."""
    return tuple(dict.fromkeys(values.count(part) for part in text.split(",")))


def counts(text: str) -> tuple[int, ...]:
    """`4,8,16` to numbers above 0, each once."""
    return tuple(dict.fromkeys(values.positive_count(part) for part in text.split(",")))


def relative_errors(text: str) -> tuple[float, ...]:
    """`0.05,0.01` to error bounds; their range is for the benchmark to check."""
    return tuple(values.length(part) for part in text.split(","))


def add_counts(parser: argparse.ArgumentParser, *rows: tuple[str, int, str]) -> None:
    """Add options that are numbers above 0: flag, default, and what it is the number of."""
    for flag, default, text in rows:
        parser.add_argument(
            flag, type=values.positive_count, default=default, metavar="N", help=f"{text} (default: {default:,})"
        )


def add_rows(parser: argparse.ArgumentParser) -> None:
    """Add --rows and --resume."""
    parser.add_argument(
        "--rows",
        type=Path,
        metavar="FILE.jsonl",
        help="write each measurement there as soon as it is done, so that one that is stopped has lost none",
    )
    parser.add_argument("--resume", action="store_true", help="go on from the rows of that file")


def rows_of(args: argparse.Namespace) -> Rows:
    """Where --rows and --resume keep measurements. Raises SettingsError and ImageError, see Rows."""
    from wdpm.bench.rows import Rows

    return Rows(args.rows, resume=args.resume)


def add_threads(parser: argparse.ArgumentParser, text: str) -> None:
    """Add --threads."""
    parser.add_argument(
        "--threads",
        type=values.positive_count,
        default=available_cores(),
        metavar="N",
        help=f"{text} (default: all cores)",
    )


def find_all(scenes: Iterable[str | Path]) -> None:
    """Raise SceneError for a scene that is not there: the last one must not cost what was measured of the others."""
    from wdpm.scenes.load import find

    for scene in scenes:
        find(scene)
