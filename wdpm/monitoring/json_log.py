"""A log of a cluster: one JSON object a line, for programs to read and for people to search."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from wdpm.cluster.cluster_events import ClusterEvent
from wdpm.scenes.errors import SettingsError


class JsonLog:
    """Writes events to the end of a file, each at once, with the time of day and the seconds since it was opened.

    A file that can be written no more (a full disk) costs the log, not the render: a person hears of it once.

    Args:
        tell: shows a line to a person.

    Raises:
        SettingsError: the file cannot be opened.
    """

    def __init__(self, path: Path, tell: Callable[[str], None]) -> None:
        self._path = path
        self._tell = tell
        self._begun = time.monotonic()
        self._full = False
        try:
            self._file = path.open("a", encoding="utf-8", buffering=1)
        except OSError as error:
            raise SettingsError(f"cannot write the log {path}: {error.strerror}") from None

    def __call__(self, event: ClusterEvent) -> None:
        """Write one line."""
        if self._full:
            return
        seconds = round(time.monotonic() - self._begun, 3)
        when = datetime.now(UTC).isoformat(timespec="milliseconds")
        try:
            self._file.write(json.dumps({"time": when, "seconds": seconds, "event": event.name, **event.facts}) + "\n")
        except OSError as error:
            self._full = True
            self._tell(f"the log {self._path} ends here: {error.strerror}")

    def close(self) -> None:
        """Nothing is written any more."""
        try:
            self._file.close()
        except OSError as error:  # what a full disk did not take
            if not self._full:
                self._tell(f"the log {self._path} is not complete: {error.strerror}")
