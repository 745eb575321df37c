"""Which transport an address means: the scheme says, as in tcp://HOST:PORT."""

from __future__ import annotations

from collections.abc import Callable

from wdpm.cluster.transport.memory import MemoryTransport
from wdpm.cluster.transport.transport import Transport
from wdpm.scenes.errors import SettingsError


def _zeromq() -> Transport:
    from wdpm.cluster.transport.zeromq.network import ZeroMQTransport  # half of the commands need no ZeroMQ

    return ZeroMQTransport()


_MEMORY = MemoryTransport()
"""Of this process: masters and slaves on threads of their own find each other there."""

_MAKERS: dict[str, Callable[[], Transport]] = {"tcp": _zeromq, "ipc": _zeromq, "memory": lambda: _MEMORY}


def register(scheme: str, make: Callable[[], Transport]) -> None:
    """Have addresses SCHEME://... mean another transport.

    Args:
        make: gives the transport, each time that a master or a slave asks for it.

    Raises:
        ValueError: the scheme means one already.
    """
    if scheme in _MAKERS:
        raise ValueError(f"addresses {scheme}:// have a transport already")
    _MAKERS[scheme] = make


def transport_of(address: str) -> Transport:
    """The transport of an address; SettingsError if its scheme is unknown."""
    make = _MAKERS.get(address.partition("://")[0])
    if make is None:
        raise SettingsError(f"'{address}' is no address; expected tcp://HOST:PORT")
    return make()
