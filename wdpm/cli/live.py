"""Options of commands that show what they render, and the page while they do."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from wdpm.cluster.display import Displays
from wdpm.scenes.errors import SettingsError
from wdpm.view.address import ViewAddress, view_address

if TYPE_CHECKING:
    from wdpm.images.view_transform import Look
    from wdpm.progress import Progress
    from wdpm.tev.display import TevDisplay
    from wdpm.view.live import LiveView


def add_view_options(parser: argparse.ArgumentParser) -> None:
    """--view, --view-at and --view-beside."""
    group = parser.add_argument_group("live view (docs/view.md; changes no bit of the image)")
    group.add_argument(
        "--view", action="store_true", help="serve a page that shows the image as it comes; prints its URL"
    )
    add_view_address(group)
    group.add_argument("--view-beside", type=Path, metavar="FILE", help="an image to compare with in the page")
    add_tev_option(group, "send the image as it comes to the viewer tev, which listens there")


def add_tev_option(group: argparse._ActionsContainer, text: str) -> None:
    """--tev."""
    group.add_argument("--tev", type=view_address, metavar="HOST:PORT", help=f"{text} (mostly 127.0.0.1:14158)")


def add_view_address(group: argparse._ActionsContainer) -> None:
    """--view-at."""
    group.add_argument(
        "--view-at",
        type=view_address,
        metavar="HOST:PORT",
        help="where to serve it (default: 127.0.0.1 and any free port; another HOST lets others in who have the URL)",
    )


def check_can_view() -> None:
    """Raise SettingsError if what serves pages is not installed."""
    try:
        import aiohttp  # noqa: F401
    except ModuleNotFoundError:
        raise SettingsError("the live view needs aiohttp: pip install 'wdpm[view]'") from None


class Viewers(Displays):
    """Whoever is shown a render: the page, tev, both."""

    def __init__(self, each: Sequence[LiveView | TevDisplay]) -> None:
        super().__init__(each)
        self._viewers = tuple(each)

    def show_as(self, look: Look) -> None:
        """Have those who can show an image as this says, at first."""
        for viewer in self._viewers:
            viewer.look = look

    def following(self, progress: Progress) -> Progress:
        """An observer of progress that tells them, too."""
        for viewer in self._viewers:
            progress = viewer.following(progress)
        return progress


@contextmanager
def shown(args: argparse.Namespace) -> Iterator[Viewers | None]:
    """Whoever `args` ask to be shown a render, while it runs; None for nobody.

    Raises:
        SettingsError, ImageError: the page cannot be served, the image to compare with cannot be read, or tev does not
            answer.
    """
    with tev_viewer(args) as tev, live_view(args) as page:
        viewers = [viewer for viewer in (page, tev) if viewer is not None]
        yield Viewers(viewers) if viewers else None


@contextmanager
def tev_viewer(args: argparse.Namespace) -> Iterator[TevDisplay | None]:
    """A connection to tev while a render runs, if `args` ask for one."""
    if args.tev is None:
        yield None
        return
    from wdpm.tev.display import TevDisplay

    display = TevDisplay(args.tev, str(args.scene))
    try:
        yield display
    finally:
        display.close()


@contextmanager
def live_view(args: argparse.Namespace) -> Iterator[LiveView | None]:
    """The page of a render while it runs, if `args` ask for one.

    Raises:
        SettingsError, ImageError: it cannot be served, or the image to compare with cannot be read.
    """
    if not args.view:
        for name in ("view_at", "view_beside"):
            if getattr(args, name) is not None:
                raise SettingsError(f"--{name.replace('_', '-')} says how to view: give --view, too")
        yield None
        return
    check_can_view()
    from wdpm.images.image import load
    from wdpm.view.live import LiveView

    several = (args.passes or 1) > 1 or args.until_error is not None or args.time_budget is not None
    beside = None if args.view_beside is None else load(args.view_beside)
    view = LiveView(args.view_at or ViewAddress(), args.scene, passes=several, beside=beside)
    how = "failed"
    try:
        print_url(view.url, args.view_at or ViewAddress())
        yield view
        how = "done: the image is written"
    except KeyboardInterrupt:
        how = "stopped"
        raise
    except Exception as error:
        how = f"failed: {error}"
        raise
    finally:
        view.close(how)


def print_url(url: str, address: ViewAddress) -> None:
    """Tell the person what to open; on standard error, so that results can be piped."""
    print(f"view: {url}", file=sys.stderr, flush=True)
    if not address.is_loopback:
        print(
            f"wdpm: the view at {address.host} is not encrypted: whoever learns its URL can watch, and stop the render",
            file=sys.stderr,
            flush=True,
        )
