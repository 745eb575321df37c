"""A slave whose connections, to its master and from its peers, lead through links that this process harms.

    python tests/chaos/linked_slave.py tcp://HOST:PORT [--delay S] [--rate BYTES] [--cut-every S]

SIGUSR1 cuts all its links for a second; SIGUSR2 has them carry nothing any more, of which nobody is told: half open.
SIGHUP has them swallow what peers send over the connections that they have just then.
"""

from __future__ import annotations

import argparse
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "helpers" / "processes"))

from links import LinkedTransport, Links

from wdpm.cluster.transport import registry
from wdpm.serving import serve

SCHEME = "linked"


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
    signal.signal(signal.SIGUSR2, links.freeze)
    signal.signal(signal.SIGHUP, links.swallow)
    if args.cut_every is not None:
        again_and_again(links.cut, args.cut_every)
    registry.register(SCHEME, lambda: LinkedTransport(links))
    serve(args.master.replace("tcp", SCHEME, 1), None, threads=1)


if __name__ == "__main__":
    main()
