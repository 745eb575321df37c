"""A slave whose connections, to its master and from its peers, lead through links that this process harms.

    python tests/chaos/linked_slave.py tcp://HOST:PORT [--delay S] [--rate BYTES] [--cut-every S]

SIGUSR1 cuts all its links for a second; SIGUSR2 has them carry nothing any more, of which nobody is told: half open.
"""

from __future__ import annotations

import argparse
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "helpers"))

from tcp_proxy import TcpProxy

from wdpm.cluster.transport import registry
from wdpm.cluster.transport.keys import Keys
from wdpm.cluster.transport.transport import Accepted, Role
from wdpm.cluster.transport.zeromq.network import ZeroMQListener, ZeroMQNetwork, ZeroMQTransport
from wdpm.serving import serve

SCHEME = "linked"
CUT_S = 1.0
"""How long a link that is cut leads nowhere [s]."""


class Links:
    """All links of this process; they stand until it ends.

    Args:
        shape: what they do to what they carry, as `TcpProxy` takes it.
    """

    def __init__(self, **shape: Any) -> None:
        self._shape = shape
        self._links: list[TcpProxy] = []
        self._stack = ExitStack()

    def to(self, target: str) -> str:
        """The address of a link to a listener."""
        link = self._stack.enter_context(TcpProxy(target, **self._shape))
        self._links.append(link)
        return link.endpoint

    def cut(self, *_: object) -> None:
        """Cut all of them for a while."""
        for link in self._links:
            link.cut(CUT_S)

    def freeze(self, *_: object) -> None:
        """Have them carry nothing any more."""
        for link in self._links:
            link.freeze()


class LinkedTransport(ZeroMQTransport):
    """ZeroMQ over links: linked://HOST:PORT is reached over one, and what listens here is reached over another."""

    def __init__(self, links: Links) -> None:
        self._links = links

    def resolve(self, address: str) -> str:
        """The link's own address in place of the master's."""
        return self._links.to(address.replace(SCHEME, "tcp", 1))

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


def again_and_again(act: Callable[[], None], seconds: float) -> None:
    """Do something every so often, on a thread of its own."""

    def loop() -> None:
        while True:
            threading.Event().wait(seconds)
            act()

    threading.Thread(target=loop, daemon=True).start()


def main() -> None:
    """Be a slave until the master says stop."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("master")
    parser.add_argument("--delay", type=float, default=0.0, help="of every byte, one way [s]")
    parser.add_argument("--rate", type=float, help="of each link and direction [bytes/s]")
    parser.add_argument("--cut-every", type=float, help="time between two cuts of all links [s]")
    args = parser.parse_args()
    links = Links(delay_s=args.delay, bytes_per_s=args.rate)
    signal.signal(signal.SIGUSR1, lambda *_: threading.Thread(target=links.cut, daemon=True).start())
    signal.signal(signal.SIGUSR2, lambda *_: links.freeze())
    if args.cut_every is not None:
        again_and_again(links.cut, args.cut_every)
    registry.register(SCHEME, lambda: LinkedTransport(links))
    serve(args.master.replace("tcp", SCHEME, 1), None, threads=1)


if __name__ == "__main__":
    main()
