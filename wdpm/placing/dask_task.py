"""What a Dask worker runs for wdpm: a slave in a process of its own.

Of its own, so that neither the worker's heartbeats nor a kernel of the slave wait for Python's lock, and so that the
slave's memory is not the worker's. It ends with the worker, however that ends, since its standard input closes then.

Dask calls these functions by name: wdpm has to be installed where the workers are, in the same version.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field

from distributed import get_worker

from wdpm.cluster.master.local_slaves import SlaveProcess, slave_command
from wdpm.devices import available_cores
from wdpm.scenes.errors import ClusterError

_SLAVES: dict[str, SlaveProcess] = {}
"""Those that run in this worker, by the name of their order."""

_LOCK = threading.Lock()


@dataclass(frozen=True)
class Order:
    """A slave that is to run.

    Attributes:
        name: no other has it.
        endpoint: of the master.
        keys: of the run, as the slave takes them from its standard input; in no text that Dask writes.
        device: that it computes on.
    """

    name: str
    endpoint: str
    keys: bytes = field(repr=False)
    device: str = "cpu"


def serve(order: Order) -> str:
    """Run a slave with the threads and the memory of the worker, and wait for its end; returns why it ended."""
    worker = get_worker()
    threads = min(worker.state.nthreads, available_cores())
    command = slave_command(threads, order.device, worker.memory_manager.memory_limit)
    try:
        slave = SlaveProcess(command(order.endpoint), order.keys)
    except ClusterError as error:
        return str(error)
    with _LOCK:
        _SLAVES[order.name] = slave
    try:
        slave.wait()
        return slave.ended() or ""
    finally:
        with _LOCK:
            del _SLAVES[order.name]
        slave.let_go()
        slave.stop(0.0)


def kill(names: list[str]) -> None:
    """End slaves of this worker that have not ended by themselves: Dask cannot, as a cancelled task goes on running."""
    with _LOCK:
        slaves = [_SLAVES[name] for name in names if name in _SLAVES]
    for slave in slaves:
        slave.kill()
