"""A render in tev: a display driver that sends what comes, on a thread of its own.

What waits is remembered as places and read when it is sent, so a slow viewer gets the latest pixels, less often, and
the render waits for nobody. A viewer that goes away costs a line.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wdpm.cluster.display import Bucket, Frame, PassMean, SlaveSeen
from wdpm.images.channels import LAYER_CHANNELS
from wdpm.images.view_transform import Look
from wdpm.progress import Progress
from wdpm.tev.connection import connected, hang_up
from wdpm.tev.packets import create_image, update_image
from wdpm.view.address import ViewAddress
from wdpm.view.picture import Picture, Rectangle

FLUSH_S = 5.0
"""That the end of a render waits at most for what tev has not taken yet."""


class TevDisplay:
    """Shows a render in tev. It is a Display (wdpm.cluster.display).

    Args:
        address: where tev listens.
        title: what the image is called there.

    Attributes:
        enough: always false: tev cannot say so.
        look: that somebody wants; tev has controls of its own for it, and shows radiance.

    Raises:
        SettingsError: tev does not answer there.
    """

    enough = False

    def __init__(self, address: ViewAddress, title: str) -> None:
        self.look = Look()
        self._address = address
        self._title = title
        self._connection = connected(address)
        self._picture = Picture()
        self._news = threading.Condition()
        self._begun = False  # an image that tev has not been told of
        self._places: dict[Rectangle, None] = {}  # in the order in which they came
        self._closing = False
        self._lost: str | None = None
        self._sender = threading.Thread(target=self._send_all, name="tev", daemon=True)
        self._sender.start()

    # A display.

    def begin(self, frame: Frame) -> None:
        """A frame begins: another image, or the next pass of the same."""
        with self._news:
            if self._picture.begin(frame):
                self._begun = True
                self._places.clear()
                self._news.notify()

    def bucket(self, bucket: Bucket) -> None:
        """Pixels are done."""
        place = self._picture.put(bucket)
        with self._news:
            self._places[place] = None
            self._news.notify()

    def slaves(self, seen: Sequence[SlaveSeen]) -> None:
        """They are no part of the image."""

    def end(self, statistics: Sequence[Mapping[str, Any]]) -> None:
        """The frame is complete, which tev need not know."""

    def pass_done(self, mean: PassMean) -> None:
        """Tev is shown the mean of what came."""

    # Beside it.

    def following(self, progress: Progress) -> Progress:
        """Another observer of progress, which also tells the person when tev is lost."""
        return _Watched(progress, self)

    def complaint(self) -> str | None:
        """Why tev gets no more, in a line; once."""
        with self._news:
            lost, self._lost = self._lost, None
        return lost

    def close(self) -> None:
        """The render has ended: send what waits, for FLUSH_S at most. May be called again."""
        with self._news:
            self._closing = True
            self._news.notify()
        self._sender.join(FLUSH_S)
        hang_up(self._connection)

    def _send_all(self) -> None:
        try:
            while (packet := self._next()) is not None:
                self._connection.sendall(packet)
        except OSError as error:
            with self._news:
                if not self._closing:
                    reason = (error.strerror or str(error)).lower()
                    self._lost = f"tev at {self._address} is shown no more: {reason}; the render goes on"

    def _next(self) -> bytes | None:
        """The next packet, as soon as there is one; None when there will be none."""
        with self._news:
            self._news.wait_for(lambda: self._begun or self._places or self._closing)
            if self._begun:
                self._begun = False
                width, height = self._picture.size
                return create_image(self._title, width, height, _channel_names(self._picture.layers))
            if not self._places:
                return None
            place = next(iter(self._places))
            del self._places[place]
            layers = self._picture.layers
        parts = [layer[place.y0 : place.y1, place.x0 : place.x1] for layer in layers.values()]
        pixels = np.concatenate([part.reshape(*part.shape[:2], -1) for part in parts], axis=2)
        return update_image(self._title, place.x0, place.y0, _channel_names(layers), pixels)


def _channel_names(layers: Mapping[str, Any]) -> list[str]:
    """As in EXR files: tev makes layers of what stands before the dot."""
    return [
        channel if layer == "beauty" else f"{layer}.{channel}" for layer in layers for channel in LAYER_CHANNELS[layer]
    ]


class _Watched:
    """An observer of progress that passes on what tev's display has to complain of, on the thread that renders."""

    def __init__(self, progress: Progress, display: TevDisplay) -> None:
        self._progress = progress
        self._display = display

    def start(self, phase: str, total: int | None = None) -> None:
        self._progress.start(phase, total)
        self._complain()

    def advance(self, amount: int = 1) -> None:
        self._progress.advance(amount)
        self._complain()

    def note(self, text: str) -> None:
        self._progress.note(text)

    def finish(self) -> None:
        self._complain()
        self._progress.finish()

    def _complain(self) -> None:
        if (complaint := self._display.complaint()) is not None:
            self._progress.note(f"wdpm: {complaint}")
