"""`wdpm compare`: error figures of one image against another, and pictures of the difference."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wdpm import values

if TYPE_CHECKING:
    from wdpm.images.image import Image
    from wdpm.images.perceptual import Flip

EXIT_BITS_DIFFER = 1

_EXAMPLES = """\
examples:
  wdpm compare render.exr reference.exr -o difference.png
  wdpm compare render.exr reference.exr --heat flip.png
  wdpm compare render.exr reference.exr --heat error.png --heat-of rel_mse
  wdpm compare one-machine.exr cluster.exr --equal && echo the same bits
  wdpm compare a.exr b.exr --region 100,40,180,90 --json"""

FLIP_KINDS = ("hdr", "ldr", "none")
HEATS = ("flip", "rel_mse", "abs")


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to the parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "compare",
        help="error figures and a picture of the difference",
        description="Compare image A with the reference B: MSE, RMSE, relMSE = mean of (A-B)^2 / (B^2 + 0.01), PSNR, "
        "FLIP (how different they look, from 0 to 1; pip install 'wdpm[flip]'), means, and whether all bits of all "
        "common layers are equal.",
        epilog=_EXAMPLES,
    )
    parser.add_argument("a", type=Path, metavar="A", help="image: .exr, .png, .hdr, .pfm or .npy")
    parser.add_argument("b", type=Path, metavar="B", help="reference, of the same size; or one is a crop of the other")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE.png", help="write a picture of the difference")
    parser.add_argument(
        "--signed", action="store_true", help="show A-B in the picture, not the relative (A-B)/sqrt(B^2+0.01)"
    )
    parser.add_argument("--heat", type=Path, metavar="FILE.png", help="write a heat map: how far each pixel is off")
    parser.add_argument(
        "--heat-of",
        choices=HEATS,
        metavar="WHAT",
        help="what it shows: flip, rel_mse or abs (default: flip, or rel_mse where there is no FLIP)",
    )
    parser.add_argument(
        "--flip",
        choices=FLIP_KINDS,
        metavar="KIND",
        help="hdr (the worst of several exposures), ldr (as a screen shows it) or none (default: ldr of two PNG "
        "files, or else hdr)",
    )
    parser.add_argument(
        "--ppd",
        type=values.length,
        metavar="N",
        help="pixels that a degree of the visual field takes in, for FLIP (default: 67, a 4K display at arm's length)",
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
    """Print the figures, write the pictures; returns the exit code."""
    from rich.console import Console

    from wdpm.images.comparison import compare
    from wdpm.images.difference_picture import difference_picture
    from wdpm.images.files import check_apart, check_output_path, png_bytes, write_bytes
    from wdpm.images.image import load
    from wdpm.images.perceptual import flip_is_installed
    from wdpm.images.windows import doubts, same_part

    for path in (args.output, args.heat):
        if path is not None:
            check_output_path(path, (".png",))
    check_apart([("the picture of the difference", args.output), ("the heat map", args.heat)])
    _check_pictures(args)
    _check_flip(args, flip_is_installed())
    a, b, cut = same_part(load(args.a), load(args.b))
    for line in ([] if cut is None else [cut]) + doubts(a, b, args.a, args.b):
        print(f"wdpm: {line}", file=sys.stderr)
    comparison = compare(a, b, args.region)
    flip = _flip(args, a, b) if args.flip != "none" and flip_is_installed() else None
    if flip is not None:
        comparison = replace(comparison, flip=flip.figures(args.region))
    if args.json:
        print(comparison.to_json())
    else:
        console = Console()
        comparison.print(console)
        if flip is None and args.flip is None:
            console.print("No FLIP: pip install 'wdpm[flip]', or --flip none.", markup=False, highlight=False)
    if args.output is not None:
        write_bytes(png_bytes(difference_picture(a, b, relative=not args.signed)), args.output)
    if args.heat is not None:
        _write_heat(args, a, b, flip)
    return EXIT_BITS_DIFFER if args.equal and not comparison.bits_equal else 0


def _check_pictures(args: argparse.Namespace) -> None:
    from wdpm.scenes.errors import SettingsError

    if args.signed and args.output is None:
        raise SettingsError("--signed says what the picture of the difference shows: give -o FILE.png, too")
    if args.heat_of is not None and args.heat is None:
        raise SettingsError("--heat-of says what a heat map shows: give --heat FILE.png, too")


def _check_flip(args: argparse.Namespace, installed: bool) -> None:
    from wdpm.scenes.errors import SettingsError, WdpmError

    if args.flip == "none" and (args.heat_of == "flip" or args.ppd is not None):
        raise SettingsError(f"--flip none leaves nothing for {'--ppd' if args.ppd is not None else '--heat-of flip'}")
    asked = args.flip in ("hdr", "ldr") or args.heat_of == "flip" or args.ppd is not None
    if asked and not installed:
        raise WdpmError("FLIP: flip-evaluator is not installed: pip install 'wdpm[flip]'")


_PIXELS_WORTH_A_BAR = 1 << 18
"""Of images whose FLIP takes longer than a person wants to wait without being told."""


def _flip(args: argparse.Namespace, a: Image, b: Image) -> Flip:
    from wdpm.images.perceptual import PIXELS_PER_DEGREE, FlipKind, flip
    from wdpm.progress import SilentProgress, make_progress

    screens = {args.a.suffix.lower(), args.b.suffix.lower()} == {".png"}
    kind = FlipKind(args.flip or ("ldr" if screens else "hdr"))
    progress = make_progress() if a.pixels.size > _PIXELS_WORTH_A_BAR * 3 else SilentProgress()
    try:
        return flip(a, b, kind, PIXELS_PER_DEGREE if args.ppd is None else args.ppd, progress)
    finally:
        progress.finish()


def _write_heat(args: argparse.Namespace, a: Image, b: Image, flip: Flip | None) -> None:
    from wdpm.images.files import png_bytes, write_bytes
    from wdpm.images.heat_map import Heat, error_map, flip_map

    heat = Heat(args.heat_of or ("rel_mse" if flip is None else "flip"))
    if heat is Heat.FLIP:
        if flip is None:
            raise AssertionError("asked for without FLIP, which _check_flip rejects")
        picture = flip_map(flip.errors)
    else:
        picture = error_map(a, b, heat)
    write_bytes(png_bytes(picture), args.heat)
