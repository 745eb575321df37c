"""`wdpm view`: look at image files in the page of the live view."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from wdpm.cli.live import add_view_address, check_can_view, print_url
from wdpm.view.address import ViewAddress

_EXAMPLES = """\
examples:
  wdpm view box.exr
  wdpm view box.exr reference.exr
  wdpm render scene.xml --view      (the same page while an image is rendered)"""


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to the parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "view",
        help="look at one image or two in a browser",
        description="Serve a page that shows one image or two: pixels with values, exposure, layers, differences. "
        "Prints its URL; Ctrl-C ends it.",
        epilog=_EXAMPLES,
    )
    parser.add_argument("image", type=Path, metavar="FILE", help="image: .exr, .png, .hdr, .pfm or .npy")
    parser.add_argument("other", type=Path, nargs="?", metavar="OTHER", help="another to compare with")
    add_view_address(parser)
    return parser


def run(args: argparse.Namespace) -> int:
    """Serve until the person has seen enough; returns the exit code."""
    check_can_view()
    from wdpm.images.image import load
    from wdpm.view.open_files import FileView

    address = args.view_at or ViewAddress()
    title = args.image.name if args.other is None else f"{args.image.name} | {args.other.name}"
    view = FileView(address, title, load(args.image), None if args.other is None else load(args.other))
    try:
        print_url(view.url, address)
        view.wait()
    finally:
        view.close()
    return 0
