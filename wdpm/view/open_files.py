"""Image files in the same page as a render."""

from __future__ import annotations

import threading
from typing import Any

from wdpm.images.image import Image
from wdpm.view.address import ViewAddress
from wdpm.view.live import state_of
from wdpm.view.picture import Picture
from wdpm.view.requests import STOP
from wdpm.view.server import ViewServer
from wdpm.view.status import Status


class FileView:
    """Shows one or two images to whoever opens its URL.

    Raises:
        SettingsError: it cannot listen there.
    """

    def __init__(self, address: ViewAddress, title: str, image: Image, other: Image | None = None) -> None:
        self._pictures = {"a": Picture(image.layers), **({} if other is None else {"b": Picture(other.layers)})}
        self._look = image.look.resolved(image.pixels)
        self._status = Status(title, passes=False)
        self._stopped = threading.Event()
        self._server = ViewServer(address, self._pictures, self._state, self._act)
        self.url = self._server.url

    def wait(self) -> None:
        """Serve until a page says stop, or Ctrl-C."""
        while not self._stopped.wait(1.0):
            continue

    def close(self) -> None:
        """End; may be called again."""
        self._status.end("closed")
        self._server.close()

    def _state(self) -> dict[str, Any]:
        state = {"pictures": state_of(self._pictures), "enough": False, "look": self._look.to_dict()}
        return {**self._status.to_dict(), **state}

    def _act(self, action: str) -> None:
        if action == STOP:
            self._stopped.set()
