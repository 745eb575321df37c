"""Addresses tcp://HOST:PORT, and which of this machine's interfaces they mean."""

from __future__ import annotations

import ipaddress
import socket

from wdpm.scenes.errors import SettingsError


def split(address: str) -> tuple[str, int]:
    """Host and port of tcp://HOST:PORT; SettingsError for anything else."""
    scheme, _, rest = address.partition("://")
    host, _, port = rest.rpartition(":")
    host = host[1:-1] if host.startswith("[") and host.endswith("]") else host
    if scheme != "tcp" or not host or not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise SettingsError(f"'{address}' is no address; expected tcp://HOST:PORT")
    return host, int(port)


def resolve(address: str) -> str:
    """The same address with a number in place of a name, since ZeroMQ binds to numbers only.

    A host * means all interfaces of this machine.
    """
    host, port = split(address)
    if host == "*":
        return f"tcp://0.0.0.0:{port}"
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except OSError as error:
        raise SettingsError(f"cannot find the machine '{host}' of {address}: {error.strerror}") from None
    except UnicodeError:  # a part between two dots that is empty, or too long
        raise SettingsError(f"cannot find the machine '{host}' of {address}: that can be no name") from None
    # Names often have both; what binds to the one kind is not reached by the other, so master and slave prefer alike.
    number = min(found, key=lambda entry: entry[0] != socket.AF_INET)[4][0]
    return join(str(number), port)


def join(number: str, port: int | str) -> str:
    """The address of a number (IPv4 or IPv6) and a port."""
    return f"tcp://[{number}]:{port}" if ":" in number else f"tcp://{number}:{port}"


def is_resolved(address: str) -> bool:
    """Whether this is the address of a number and a port, so that nobody need be asked what it means."""
    try:
        _number(address)
    except (SettingsError, ValueError):
        return False
    return True


def is_loopback(resolved: str) -> bool:
    """Whether only this machine can reach a resolved address."""
    return _number(resolved).is_loopback


def interface_towards(resolved: str) -> str:
    """This machine's own number on the way to a resolved address."""
    host, port = split(resolved)
    family = socket.AF_INET if _number(resolved).version == 4 else socket.AF_INET6
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((host, max(port, 1)))  # a datagram socket sends nothing when it connects
        except OSError as error:
            raise SettingsError(f"no network reaches {resolved}: {error.strerror}") from None
        return str(probe.getsockname()[0])


def _number(resolved: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address:
    return ipaddress.ip_address(split(resolved)[0])
