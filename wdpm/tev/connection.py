"""A connection to tev: nobody waits for it longer than a few seconds."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterable

from wdpm.scenes.errors import SettingsError
from wdpm.view.address import ViewAddress

CONNECT_S = 3.0
SEND_S = 5.0
"""For a packet: tev takes them while it draws, so one that takes longer has stopped, or is behind a broken line."""


def connected(address: ViewAddress) -> socket.socket:
    """Connect. Raises SettingsError if tev does not answer there."""
    try:
        connection = socket.create_connection((address.host, address.port), CONNECT_S)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise SettingsError(f"tev does not answer at {address}: {reason}; start it first, or leave --tev out") from None
    connection.settimeout(SEND_S)
    return connection


def hang_up(connection: socket.socket) -> None:
    """End a connection, also while another thread sends: closing it alone would not wake that one."""
    with contextlib.suppress(OSError):  # the other end has gone
        connection.shutdown(socket.SHUT_RDWR)
    connection.close()


def tell(address: ViewAddress, packets: Iterable[bytes]) -> None:
    """Send packets, and be done. Raises SettingsError if tev does not answer, or does not take them."""
    with connected(address) as connection:
        try:
            for packet in packets:
                connection.sendall(packet)
        except OSError as error:
            raise SettingsError(f"tev at {address} does not listen: {(error.strerror or str(error)).lower()}") from None
