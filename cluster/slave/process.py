"""A slave as a process runs it: it joins a master and computes until that says stop.

The calling thread owns the network: a connection to the master, a listener for its peers, a connection to each peer.
One other thread computes.
"""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Callable, Mapping
from contextlib import ExitStack

from wdpm.cluster.host_memory import machine_memory
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.messages import protocol
from wdpm.cluster.slave.account import Account
from wdpm.cluster.slave.computer import ComputeThread
from wdpm.cluster.slave.job_queue import HOLD_S
from wdpm.cluster.slave.jobs import Compute, WorkerFactory
from wdpm.cluster.slave.loop import FROM_PEER, SlaveLoop, SlaveShell, Tell
from wdpm.cluster.slave.machine import Slave
from wdpm.cluster.transport.keys import Keys
from wdpm.cluster.transport.registry import transport_of
from wdpm.cluster.transport.transport import Role
from wdpm.cluster.versions import versions

PATIENCE_S = 60.0
"""How long a slave waits for a master's first answer unless told otherwise: people start slaves first, too."""


def run_slave(
    master: str,
    make_worker: WorkerFactory,
    *,
    threads: int = 1,
    memory: int | None = None,
    security: Keys | None = None,
    patience: float = PATIENCE_S,
    rejoin: float | None = None,
    life_line: int | None = None,
    tell: Tell | None = None,
    limits: ClusterLimits | None = None,
    agreed: Mapping[str, str] | None = None,
    tell_scene: Callable[[str], None] | None = None,
) -> None:
    """Compute for a master until it says stop.

    Args:
        master: its address, of any transport: tcp://HOST:PORT, say.
        threads: cores, as told to the master.
        memory: main memory that it may use, as told to the master [bytes]; None for the machine's.
        patience: how long it waits for the master's first answer [s].
        rejoin: how long it waits for a master that it has lost [s]; None for as long.
        life_line: file descriptor of a pipe whose other end the process that started it holds; when that closes,
            it ends.
        tell: shows a line to a person; None for standard error.
        tell_scene: is told the name of each scene before `make_worker` is called for it.

    Raises:
        ClusterError: no master answered, it refused, or something failed.
    """
    transport = transport_of(master)
    resolved = transport.resolve(master)
    with ExitStack() as stack:
        network = transport.open(security)
        stack.callback(network.close)
        listener = network.listen(network.address_for_peers(resolved), Role.SLAVE, FROM_PEER)
        hello = protocol.Hello(
            dict(versions() if agreed is None else agreed),
            platform.node() or "unknown",
            os.getpid(),
            threads,
            machine_memory(),
            listener.endpoint,
            own_memory=memory or 0,
        )
        state = Slave(hello, master, patience, limits, rejoin, HOLD_S)
        computer = ComputeThread(Compute(make_worker, tell_scene=tell_scene))
        shell = SlaveShell(
            state,
            network,
            listener,
            resolved,
            computer.submit,
            tell or _to_stderr,
            account=Account(),
            run_here=computer.run_here,
        )
        stack.callback(shell.close)
        SlaveLoop(shell, network, computer, life_line).run()


def _to_stderr(text: str) -> None:
    print(f"wdpm slave: {text}", file=sys.stderr, flush=True)
