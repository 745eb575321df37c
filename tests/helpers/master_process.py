"""A master process that renders too slowly to end: master_process.py [life-line].

Prints the process numbers of its slaves.
"""

import signal
import sys

from fake_worker import make_session, make_view
from slow_slaves import AGREED, slow_slave

from wdpm.cluster.master.local_slaves import LocalSlaves
from wdpm.cluster.master.server import MasterServer


class TellWhenRendering:
    def start(self, phase: str, total: int | None = None) -> None:  # noqa: ARG002 - a Progress
        if phase == "render":
            print("rendering", flush=True)

    def advance(self, amount: int = 1) -> None: ...

    def note(self, text: str) -> None: ...


signal.signal(signal.SIGINT, signal.default_int_handler)  # a parent may have had it ignored
slaves = LocalSlaves()
with MasterServer("tcp://127.0.0.1:0", 2, agreed=AGREED) as master:
    slaves.start(2, slow_slave(1.0, *sys.argv[1:]), master.endpoint)
    print(*slaves.processes, flush=True)
    try:
        master.render(make_session(2, 2, view=make_view(640, 640)), TellWhenRendering())
    finally:
        master.close("the test is over")
        slaves.stop()
