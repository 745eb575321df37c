"""`wdpm bench peers`: its options, and what it does with them."""

from __future__ import annotations

import argparse
from pathlib import Path

from wdpm import values
from wdpm.bench.commands.arguments import (
    add_counts,
    add_rows,
    add_threads,
    counts,
    relative_errors,
    rows_of,
)
from wdpm.bench.commands.benchmark import Benchmark, Measured
from wdpm.bench.peers.grid import DEFAULT_WAYS, WAYS
from wdpm.progress import Progress
from wdpm.rendering.backend import Backends
from wdpm.scenes.errors import SettingsError

_DESCRIPTION = """\
Time that wdpm and Mitsuba 3's path tracer take to reach given errors, both warm,
at the size of each scene's reference. For wdpm, --ways chooses what is measured:
the fastest of a fixed grid of settings, or of a part of it (map, gather, cache);
the defaults; its own path tracer. Mitsuba is measured at several numbers of
samples; between and beyond these, error = a / samples. If Mitsuba does not find
LLVM's library, name it in the environment variable DRJIT_LIBLLVM_PATH. CPU time
is that of all threads and processes, which other work hardly changes."""


_WAYS = tuple(way.name for way in WAYS)
_DEFAULT_WAYS = tuple(way.name for way in DEFAULT_WAYS)


def _ways(text: str) -> tuple[str, ...]:
    """`defaults,path` to names of ways, each once."""
    names = tuple(dict.fromkeys(text.split(",")))
    for name in names:
        if name not in _WAYS:
            raise argparse.ArgumentTypeError(f"'{name}' is no way; expected some of {','.join(_WAYS)}")
    return names


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add its options."""
    parser.add_argument("scenes", nargs="+", type=Path, metavar="SCENE.xml", help="Mitsuba scenes")
    parser.add_argument(
        "--reference", type=Path, metavar="FILE", help="of a single scene (default: reference.exr beside each scene)"
    )
    parser.add_argument(
        "--errors",
        type=relative_errors,
        metavar="E,E,...",
        help="bounds of the relMSE (default: 0.05,0.02,0.01,0.005, unless --samples is given)",
    )
    parser.add_argument(
        "--samples",
        type=counts,
        default=(),
        metavar="N,N,...",
        help="also reach the errors that Mitsuba has with so many samples: measured where --limit allows it, else "
        "by error = a / samples",
    )
    parser.add_argument(
        "--trim",
        type=values.length,
        default=0.0,
        metavar="SHARE",
        help="reach every error also without this share of the pixels, the worst ones, like 0.001 (default: 0, do not)",
    )
    parser.add_argument(
        "--ways",
        type=_ways,
        default=_DEFAULT_WAYS,
        metavar="WAY,...",
        help=f"of wdpm: some of {','.join(_WAYS)} (default: {','.join(_DEFAULT_WAYS)})",
    )
    parser.add_argument(
        "--region", type=values.region, metavar="L,T,R,B", help="pixels that count (default: the whole image)"
    )
    parser.add_argument(
        "--limit",
        type=values.length,
        default=60.0,
        metavar="SECONDS",
        help="leave out renders that are expected to take longer (default: 60)",
    )
    add_counts(parser, ("--rounds", 2, "images that confirm a choice of settings"))
    add_threads(parser, "threads of each")
    add_rows(parser)


def run(args: argparse.Namespace, backends: Backends, progress: Progress) -> Measured:
    """Time to errors of the whole image, next to Mitsuba's."""
    from wdpm.bench.peers import measure as bench_peers
    from wdpm.bench.peers.target import DEFAULT_ERRORS, Bounds

    if args.reference is not None and len(args.scenes) > 1:
        raise SettingsError(
            f"--reference is of one scene, and there are {len(args.scenes)}: put a reference.exr beside each"
        )
    errors = args.errors or (() if args.samples else DEFAULT_ERRORS)
    bounds = Bounds(errors, args.region, args.rounds, args.limit, args.samples, args.trim)
    ways = [way for way in WAYS if way.name in args.ways]
    pairs = [(scene, args.reference or bench_peers.default_reference(scene)) for scene in args.scenes]
    for scene, reference in pairs:
        bench_peers.check(scene, reference, bounds)
    rows = rows_of(args)
    with backends(0) as backend:
        figures = [
            bench_peers.measure(scene, reference, bounds, backend, progress, ways=ways, rows=rows)
            for scene, reference in pairs
        ]
    return Measured([each.grid() for each in figures], {"peers": [each.to_dict() for each in figures]})


BENCHMARK = Benchmark("peers", "time to an error, next to Mitsuba 3's path tracer", _DESCRIPTION, add_arguments, run)
