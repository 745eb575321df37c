"""`wdpm view`: look at image files in the page of the live view."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from wdpm.cli.live import add_tev_option, add_view_address, check_can_view, print_url
from wdpm.cli.options import add_look_options
from wdpm.scenes.errors import SettingsError
from wdpm.view.address import ViewAddress

_EXAMPLES = """\
examples:
  wdpm view box.exr
  wdpm view box.exr reference.exr
  wdpm view box.exr --tev 127.0.0.1:14158
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
    add_look_options(parser)
    add_tev_option(parser, "have the viewer tev, which listens there, open them in place of a page")
    return parser


def run(args: argparse.Namespace) -> int:
    """Serve until the person has seen enough; returns the exit code."""
    if args.tev is not None:
        return _open_in_tev(args)
    check_can_view()
    from wdpm.images.image import load
    from wdpm.view.open_files import FileView

    address = args.view_at or ViewAddress()
    title = args.image.name if args.other is None else f"{args.image.name} | {args.other.name}"
    image = load(args.image).looking(args.exposure, args.view_transform)
    view = FileView(address, title, image, None if args.other is None else load(args.other))
    try:
        print_url(view.url, address)
        view.wait()
    finally:
        view.close()
    return 0


def _open_in_tev(args: argparse.Namespace) -> int:
    """Tell tev to read the files; returns the exit code."""
    from wdpm.images.image import load
    from wdpm.tev.connection import tell
    from wdpm.tev.packets import open_image

    if args.view_at is not None:
        raise SettingsError("--view-at is where a page is served, and --tev shows none; leave one of them out")
    files = [path for path in (args.image, args.other) if path is not None]
    for path in files:
        load(path)  # tev says nothing to us of what it cannot read
    tell(args.tev, [open_image(path.resolve()) for path in files])
    return 0
