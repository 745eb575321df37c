"""Where the page is served: HOST:PORT, and who may know it."""

from __future__ import annotations

import argparse
import ipaddress
from dataclasses import dataclass

LOOPBACK = "127.0.0.1"


@dataclass(frozen=True)
class ViewAddress:
    """Where to listen; port 0 takes a free one."""

    host: str = LOOPBACK
    port: int = 0

    def __str__(self) -> str:
        return f"{self._bracketed}:{self.port}"

    @property
    def _bracketed(self) -> str:
        return f"[{self.host}]" if ":" in self.host else self.host

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine can reach it."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"

    def url(self, token: str) -> str:
        """What to open in a browser."""
        return f"http://{self}/{token}/"


def view_address(text: str) -> ViewAddress:
    """`PORT`, `HOST:PORT` or `[IPv6]:PORT`, for argparse."""
    host, _, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]") or LOOPBACK
    if not (port.isascii() and port.isdecimal() and int(port) <= 65535):
        raise argparse.ArgumentTypeError(f"'{text}' is no HOST:PORT, like 127.0.0.1:7118; port 0 is any free one")
    try:
        host.encode("idna")  # as whoever looks it up does
    except UnicodeError:
        raise argparse.ArgumentTypeError(f"'{text}': '{host}' can be no name of a machine") from None
    return ViewAddress(host, int(port))
