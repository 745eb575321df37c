"""A render that shows itself in a notebook: the image as it comes, and a bar for the phase that it is in.

It needs no widgets: notebooks of all kinds update what is displayed in place, and keep it when they are saved.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from html import escape
from typing import Any, Protocol

import numpy as np

from wdpm.cluster.display import Bucket, Display, Displays, Frame, PassMean, SlaveSeen
from wdpm.given import check_follows
from wdpm.images.files import png_bytes
from wdpm.images.view_transform import Look, shown_pixels
from wdpm.progress import Progress, SilentProgress
from wdpm.quiet import quiet_warp
from wdpm.rendering.prepare import Source, scene_of
from wdpm.scenes.model.scene import Scene
from wdpm.view.picture import Picture

SHARE = 0.02
"""Of the time of a render, that showing it may take."""

PICTURE_S, BAR_S = 0.5, 0.2
"""No sooner is either shown again."""


class Place(Protocol):
    """Where something is displayed, to be replaced."""

    def update(self, data: Mapping[str, Any], *, raw: bool) -> None:
        """Show data, by MIME type, in place of what was there."""


class LiveRender:
    """A display and an observer of progress that draw into a notebook. All calls come from the thread that renders.

    Args:
        picture, bar: where to draw.
        beside: another observer that is told as well.
        clock: seconds, growing.

    Attributes:
        enough: always false: nobody can say so here.
        look: how the picture is shown.
    """

    enough = False

    def __init__(
        self, picture: Place, bar: Place, beside: Progress, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._picture_place, self._bar_place, self._beside, self._clock = picture, bar, beside, clock
        self.look = Look()
        self._picture = Picture()
        self._began = self._phase_began = clock()
        self._next_picture = self._next_bar = -1.0
        self._phase, self._done = "", 0
        self._total: int | None = None

    # A display.

    def begin(self, frame: Frame) -> None:
        self._picture.begin(frame)

    def bucket(self, bucket: Bucket) -> None:
        self._picture.put(bucket)
        self._show()

    def slaves(self, seen: Sequence[SlaveSeen]) -> None:
        """They are no part of the picture."""

    def end(self, statistics: Sequence[Mapping[str, Any]]) -> None:
        """What slaves did is in the report."""

    def pass_done(self, mean: PassMean) -> None:
        """The mean of what came is shown already."""

    # An observer of progress.

    def start(self, phase: str, total: int | None = None) -> None:
        self._beside.start(phase, total)
        self._phase, self._total, self._done, self._phase_began = phase, total, 0, self._clock()
        self._draw_bar()

    def advance(self, amount: int = 1) -> None:
        self._beside.advance(amount)
        self._done += amount
        if self._clock() >= self._next_bar:
            self._draw_bar()

    def note(self, text: str) -> None:
        self._beside.note(text)

    def finish(self) -> None:
        self._beside.finish()

    # What is drawn.

    def close(self, how: str) -> None:
        """The render has ended, `how` in a word: what was shown last is shown as it is now."""
        self._show(now=True)
        self._bar(f"{how} in {self._clock() - self._began:.1f} s", "")

    def _show(self, *, now: bool = False) -> None:
        began = self._clock()
        beauty = self._picture.layers.get("beauty")
        if beauty is None or not (now or began >= self._next_picture):
            return
        # A pixel that is not finite is the image's to complain of.
        pixels = shown_pixels(np.nan_to_num(beauty), self.look)
        self._picture_place.update({"image/png": png_bytes(pixels)}, raw=True)
        ended = self._clock()
        self._next_picture = ended + max(PICTURE_S, (ended - began) / SHARE)

    def _draw_bar(self) -> None:
        self._next_bar = self._clock() + BAR_S
        seconds = self._clock() - self._phase_began
        if self._total:
            share = min(self._done / self._total, 1.0)
            left = f", about {seconds * (1.0 / share - 1.0):.0f} s left" if share > 0 else ""
            self._bar(f"{self._phase}: {self._done:,} of {self._total:,}{left}", f' value="{share:.4f}"')
        else:
            self._bar(self._phase, "")

    def _bar(self, text: str, value: str) -> None:
        bar = f"<progress{value}></progress> " if value else ""
        self._bar_place.update({"text/html": f"{bar}{escape(text)}", "text/plain": text}, raw=True)


@contextmanager
def shown_live(
    live: bool, source: Source, display: Display | None, progress: Progress | None
) -> Iterator[tuple[Source, Display | None, Progress | None]]:
    """What a render is to tell, so that it is seen in the notebook, too, where `live` asks for that and there is one.

    Elsewhere that is said in a line, and the render goes on without. The source is among it: its scene says how the
    picture is to look.

    Raises:
        SettingsError: a display or an observer of progress is none.
    """
    check_follows("progress", progress, Progress)
    check_follows("display", display, Display)
    if not live:
        yield source, display, progress
        return
    if not in_notebook():
        print("wdpm: live=True shows the image in a notebook, which this is not: it renders without", file=sys.stderr)
        yield source, display, progress
        return
    quiet_warp()  # its lines for each kernel would stand above the picture
    shown = LiveRender(*_places(), progress or SilentProgress())
    how = "failed"

    def seen() -> Scene:
        scene = scene_of(source)
        shown.look = Look(scene.exposure)
        return scene

    try:
        yield seen, shown if display is None else Displays([display, shown]), shown
        how = "done"
    except KeyboardInterrupt:
        how = "interrupted"
        raise
    finally:
        shown.close(how)


def in_notebook() -> bool:
    """Whether a notebook runs this: IPython with a kernel, not a terminal's."""
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    return getattr(shell, "kernel", None) is not None


def _places() -> tuple[Place, Place]:
    """Where the picture goes, and above it the bar. Only for notebooks, which have IPython."""
    from IPython.display import display

    bar = display({"text/plain": "wdpm"}, raw=True, display_id=True)
    picture = display({"text/plain": ""}, raw=True, display_id=True)
    return picture, bar
