"""Links in place of a slave's connections: with its master, and with the peers that connect to it."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

from tcp_proxy import TcpProxy

from wdpm.cluster.transport.keys import Keys
from wdpm.cluster.transport.transport import Accepted, Role
from wdpm.cluster.transport.zeromq.network import ZeroMQListener, ZeroMQNetwork, ZeroMQTransport

CUT_S = 1.0
"""How long a link that is cut leads nowhere [s]."""


class Links:
    """All links of a slave; they stand until its process ends, or they are closed.

    Args:
        shape: what they do to what they carry, as `TcpProxy` takes it.

    Attributes:
        opened: them, in order: to the master first, then to where the slave listens.
    """

    def __init__(self, **shape: Any) -> None:
        self._shape = shape
        self.opened: list[TcpProxy] = []
        self._stack = ExitStack()

    def to(self, target: str) -> str:
        """The address of a link to a listener."""
        link = self._stack.enter_context(TcpProxy(target, **self._shape))
        self.opened.append(link)
        return link.endpoint

    def close(self) -> None:
        """Break all of them."""
        self._stack.close()

    def cut(self, *_: object) -> None:
        """Cut all of them for a while."""
        for link in self.opened:
            link.cut(CUT_S)

    def swallow(self, *_: object) -> None:
        """Have what peers send over the connections that they have now come to nothing; its answers are carried."""
        for link in self.opened[1:]:
            link.swallow(*range(link.opened), there=True)

    def freeze(self, *_: object) -> None:
        """Have them carry nothing any more."""
        for link in self.opened:
            link.freeze()


class LinkedTransport(ZeroMQTransport):
    """ZeroMQ over links: SCHEME://HOST:PORT is reached over one, and what listens here is reached over another."""

    def __init__(self, links: Links) -> None:
        self._links = links

    def resolve(self, address: str) -> str:
        """The link's own address in place of the master's."""
        return self._links.to(f"tcp://{address.partition('://')[2]}")

    def open(self, keys: Keys | None) -> ZeroMQNetwork:
        """A network whose listeners are reached over links."""
        return LinkedNetwork(keys, self._links)


class LinkedNetwork(ZeroMQNetwork):
    """Tells peers the address of a link."""

    def __init__(self, keys: Keys | None, links: Links) -> None:
        super().__init__(keys)
        self._links = links

    def listen(self, address: str, role: Role, accepted: Accepted) -> ZeroMQListener:
        """Listen there, and say that it is at the link's end."""
        listener = super().listen(address, role, accepted)
        listener._endpoint = self._links.to(listener.endpoint)
        return listener
