"""`wdpm compare`: error figures of one image against another, and a picture of the difference."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from wdpm import cli_values as values

EXIT_BITS_DIFFER = 1

_EXAMPLES = """\
examples:
  wdpm compare render.exr reference.exr -o difference.png
  wdpm compare one-machine.exr cluster.exr --equal && echo the same bits
  wdpm compare a.exr b.exr --region 100,40,180,90 --json"""


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to the parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "compare",
        help="error figures and a picture of the difference",
        description="Compare image A with the reference B: MSE, RMSE, relMSE = mean of (A-B)^2 / (B^2 + 0.01), PSNR, "
        "means, and whether all bits of all common layers are equal.",
        epilog=_EXAMPLES,
    )
    parser.add_argument("a", type=Path, metavar="A", help="image: .exr, .png, .hdr, .pfm or .npy")
    parser.add_argument("b", type=Path, metavar="B", help="reference, of the same size")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE.png", help="write a picture of the difference")
    parser.add_argument(
        "--signed", action="store_true", help="show A-B in the picture, not the relative (A-B)/sqrt(B^2+0.01)"
    )
    parser.add_argument(
        "--region",
        type=values.region,
        metavar="L,T,R,B",
        help="figures of these pixels only: left, top, right, bottom; right and bottom not included (default: all)",
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument("--equal", action="store_true", help="exit with 1 when a bit differs")
    return parser


def run(args: argparse.Namespace) -> int:
    """Print the figures, write the picture; returns the exit code."""
    from rich.console import Console

    from wdpm.comparison import compare
    from wdpm.difference_picture import difference_picture
    from wdpm.image import load
    from wdpm.image_files import check_output_path, png_bytes, write_bytes

    if args.output is not None:
        check_output_path(args.output, (".png",))
    a, b = load(args.a), load(args.b)
    comparison = compare(a, b, args.region)
    if args.json:
        print(comparison.to_json())
    else:
        comparison.print(Console())
    if args.output is not None:
        write_bytes(png_bytes(difference_picture(a, b, relative=not args.signed)), args.output)
    return EXIT_BITS_DIFFER if args.equal and not comparison.bits_equal else 0
