"""The view of a render: a display driver for the master, and an observer of its progress."""

from __future__ import annotations

import _thread
import signal
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from wdpm.cluster.display import Bucket, Frame, PassMean, SlaveSeen
from wdpm.images.image import Image
from wdpm.images.view_transform import Look
from wdpm.progress import Progress
from wdpm.view.address import ViewAddress
from wdpm.view.picture import Picture
from wdpm.view.requests import ENOUGH, STOP
from wdpm.view.server import ViewServer
from wdpm.view.status import Status
from wdpm.view.tiles import tiles_of

ERROR_SHARE = 0.005
"""Of the time of a render, that working out its error for the page may take."""


def interrupt() -> None:
    """Have the main thread interrupted, as Ctrl-C does."""
    if hasattr(signal, "pthread_kill"):  # so that a system call that waits ends, too
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    else:
        _thread.interrupt_main()


class LiveView:
    """Shows a render to whoever opens its URL. It is a Display (wdpm.cluster.display).

    Args:
        address: where to listen.
        title: of the page.
        passes: whether there may be several passes, so that one can have enough of them.
        beside: an image to compare with.
        stop: ends the render.

    Attributes:
        enough: whether a page said that the passes so far are good enough.
        url: what to open in a browser.
        look: how pages show the image at first; one with an exposure of None follows the image.

    Raises:
        SettingsError: it cannot listen there.
    """

    def __init__(
        self,
        address: ViewAddress,
        title: str,
        *,
        passes: bool = False,
        beside: Image | None = None,
        stop: Callable[[], None] = interrupt,
    ) -> None:
        self.enough = False
        self.look = Look()
        self._stop = stop
        self._status = Status(title, passes)
        self._picture = Picture()
        self._pictures = {"a": self._picture, **({} if beside is None else {"b": Picture(beside.layers)})}
        self._error_s = self._last_error_s = 0.0
        self._server = ViewServer(address, self._pictures, self._state, self._act)
        self.url = self._server.url

    # A display.

    def begin(self, frame: Frame) -> None:
        """A frame begins."""
        self._status.begin(frame, self._picture.begin(frame))
        self._server.hurry()

    def bucket(self, bucket: Bucket) -> None:
        """Pixels are done."""
        self._status.bucket(bucket)
        self._server.changed([self._picture.put(bucket)])

    def slaves(self, seen: Sequence[SlaveSeen]) -> None:
        """What slaves hold and take."""
        self._status.see(seen)
        self._server.hurry()

    def end(self, statistics: Sequence[Mapping[str, Any]]) -> None:
        """The frame is complete."""
        self._status.end_frame(statistics)

    def pass_done(self, mean: PassMean) -> None:
        """Show the exact mean and its error, as often as ERROR_SHARE allows."""
        if self._error_s + self._last_error_s > ERROR_SHARE * self._status.seconds:
            return
        began = time.perf_counter()
        figure = mean.relative_error()
        if figure is not None:
            self._status.error(mean.spp, figure)
            self._picture.replace(mean.layers())
            self._server.changed(list(tiles_of(*self._picture.size)))
        self._last_error_s = time.perf_counter() - began
        self._error_s += self._last_error_s

    # Beside it.

    def following(self, progress: Progress) -> Progress:
        """Another observer of progress that tells both it and the page."""
        return Followed(progress, self._status)

    def close(self, how: str) -> None:
        """The render has ended, `how` in a line; pages keep what they have. May be called again."""
        self._status.end(how)
        self._server.close()

    def _state(self) -> dict[str, Any]:
        state = {"pictures": state_of(self._pictures), "enough": self.enough, "look": self.look.to_dict()}
        return {**self._status.to_dict(), **state}

    def _act(self, action: str) -> None:
        if action == STOP:
            self._status.note("stopped from the page")
            self._stop()
        elif action == ENOUGH:
            self.enough = True
        self._server.hurry()


class Followed:
    """Tells an observer of progress, and the page."""

    def __init__(self, progress: Progress, status: Status) -> None:
        self._progress = progress
        self._status = status

    def start(self, phase: str, total: int | None = None) -> None:
        self._progress.start(phase, total)
        self._status.start(phase, total)

    def advance(self, amount: int = 1) -> None:
        self._progress.advance(amount)
        self._status.advance(amount)

    def note(self, text: str) -> None:
        self._progress.note(text)
        self._status.note(text)

    def finish(self) -> None:
        self._progress.finish()


def state_of(pictures: Mapping[str, Picture]) -> dict[str, Any]:
    """What a page needs to know of pictures before it wants their pixels."""
    state = {}
    for name, picture in pictures.items():
        image, layers = picture.now
        width, height = picture.size
        state[name] = {"image": image, "width": width, "height": height, "layers": list(layers)}
    return state
