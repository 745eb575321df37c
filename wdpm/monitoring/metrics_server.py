"""The server of metrics: few visitors at a time, each for a while, so that none takes files that the render needs."""

from __future__ import annotations

import socket
import sys
import threading
from collections.abc import Callable
from io import StringIO
from socketserver import ThreadingMixIn
from typing import Any, TextIO
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer

AT_ONCE = 16
"""Connections; others are closed. Whoever reads metrics comes every few seconds, for milliseconds."""

PATIENCE_S = 10.0
"""How long a visitor may say or take nothing."""


class MetricsServer(ThreadingMixIn, WSGIServer):
    """Serves a WSGI application on threads of its own, until it is closed.

    Args:
        host: a name or an address, of IPv6 as well.
        port: 0 takes a free one.

    Raises:
        OSError: it cannot listen there.
    """

    daemon_threads = True

    def __init__(self, host: str, port: int, application: Callable[..., Any]) -> None:
        self.address_family, *_, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        self._places = threading.BoundedSemaphore(AT_ONCE)
        super().__init__((str(place[0]), port), _Visit)
        self.set_app(application)
        self._thread = threading.Thread(target=self.serve_forever, name="wdpm metrics", daemon=True)
        self._thread.start()

    def verify_request(self, *_: Any) -> bool:
        """Whether there is a place: one too many is hung up on."""
        return self._places.acquire(blocking=False)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer on a thread of its own."""
        try:
            super().process_request(request, client_address)
        except RuntimeError:  # no thread can be started
            self._places.release()
            raise

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer, and make room for the next."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._places.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Who is gone, or too slow, is no error of the render."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)

    def close(self) -> None:
        """Serve nothing any more."""
        self.shutdown()
        self.server_close()
        self._thread.join()


class _Visit(WSGIRequestHandler):
    timeout = PATIENCE_S

    def log_message(self, *_: Any) -> None:
        """Nothing: the terminal is the render's."""

    def get_stderr(self) -> TextIO:
        """Where it is told what the library could not answer (with 500): versions of a format that are no numbers, say.

        Nowhere: whoever reaches the port would fill the render's log.
        """
        return StringIO()
