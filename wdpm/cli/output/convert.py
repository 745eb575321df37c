"""`wdpm convert`: an image in other formats, at another exposure."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from wdpm.cli.options import add_look_options

_EXAMPLES = """\
examples:
  wdpm convert box.exr box.png --exposure 1.5
  wdpm convert box.exr box.png --exposure auto --view-transform agx
  wdpm convert box.exr box.hdr box.pfm"""


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to the parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "convert",
        help="write an image in another format, or at another exposure",
        description="Write an image in other formats. PNG shows it, by an exposure and a view transform; the others "
        "hold the same radiance, of the beauty layer, EXR all layers and the header.",
        epilog=_EXAMPLES,
    )
    parser.add_argument("image", type=Path, metavar="FILE", help="image: .exr, .png, .hdr, .pfm or .npy")
    parser.add_argument("output", type=Path, nargs="+", metavar="OUTPUT", help="file to write, of any of these formats")
    add_look_options(parser)
    return parser


def run(args: argparse.Namespace) -> int:
    """Read, and write every output; returns the exit code."""
    from wdpm.images.files import check_apart, check_output_path
    from wdpm.images.image import load

    outputs = [check_output_path(path) for path in args.output]
    check_apart([("the image to read", args.image), *((f"output {path.name}", path) for path in outputs)])
    image = load(args.image)
    if args.exposure is not None or args.view_transform is not None:
        image = image.looking(args.exposure, args.view_transform)
    for path in outputs:
        image.save(path)
        stops = f" at {image.look.exposure:+g} stops" if path.suffix.lower() == ".png" and image.look.exposure else ""
        print(f"wrote {path}{stops}")
    return 0
