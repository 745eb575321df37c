"""What `wdpm slave` runs. Warp is imported no sooner than there is work: whoever cannot join should hear so at once."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from wdpm.cluster.limits import MOST_SLAVES
from wdpm.cluster.slave.process import PATIENCE_S, run_slave
from wdpm.cluster.transport import local_sockets, open_files
from wdpm.cluster.transport.keys import Keys
from wdpm.cluster.transport.parent_watch import has_ended
from wdpm.cluster.transport.parent_watch import life_line as line_to_watch
from wdpm.cluster.transport.registry import transport_of
from wdpm.cluster.transport.transport import Role
from wdpm.cluster.transport.zeromq.key_files import keys_for
from wdpm.cluster.transport.zeromq.run_keys import FROM_STANDARD_INPUT, slave_keys
from wdpm.devices import available_cores, check_device, check_threads
from wdpm.quiet import quiet_warp
from wdpm.scenes.errors import MachineError, SettingsError, WdpmError
from wdpm.startup import let_collector_go

if TYPE_CHECKING:
    from wdpm.cluster.slave.jobs import Worker
    from wdpm.cluster.world import World
    from wdpm.scenes.flat.arrays import Triangles


def security_of(master: str, keys: Path | None, insecure: bool) -> Keys | None:
    """This slave's keys; None for none.

    Args:
        master: address, see serve.
        keys: folder of keys, or "-" for those that the process that started this one writes to standard input.
        insecure: there are no keys.

    Raises:
        SettingsError: they cannot be read, there are none where there must be, or the address is no safe one.
    """
    resolved = transport_of(master).resolve(master)
    if keys == Path(FROM_STANDARD_INPUT):
        return slave_keys(sys.stdin.buffer.readline())
    return keys_for(resolved, keys, insecure, Role.SLAVE)


def serve(
    master: str,
    security: Keys | None,
    *,
    threads: int | None = None,
    device: str = "cpu",
    memory: int | None = None,
    patience: float = PATIENCE_S,
    rejoin: float | None = None,
    wait_for_kernels: bool = True,
    life_line: bool = False,
) -> None:
    """Compute for a master until it says stop.

    Args:
        master: tcp://HOST:PORT, or ipc://FOLDER/NAME of one that this user runs on this machine.
        security: this slave's keys, see security_of.
        memory: most memory to use [bytes]; None for no limit.
        patience: how long to wait for the master's first answer [s].
        rejoin: how long to wait for a master that was lost [s]; None for as long.
        wait_for_kernels: compile a scene's own kernels first where others could stand in for them.
        life_line: end when standard input closes, which the process that started this one holds open.

    Raises:
        SettingsError: the device is not there, the threads cannot be, or too few files may be open.
        ClusterError: no master answered, it refused, or something failed.
    """
    if device != "cpu":
        quiet_warp()
        check_device(device)
    check_threads(threads)
    if memory is not None:
        limit_memory(memory)
    open_files.allow(MOST_SLAVES)
    open_files.require_as_slave(peers=0)

    scene = ""  # that a worker is made for
    neighbours = local_sockets.shared_with(master)

    def tell_scene(name: str) -> None:
        nonlocal scene
        scene = name

    def make_worker(number: int, world: World, partition: Mapping[int, Triangles], holders: Sequence[int]) -> Worker:
        from wdpm.cluster.host_cache import HostCache
        from wdpm.cluster.work.worker import CellWorker
        from wdpm.kernels.launch import Launcher

        _prepare(device)
        let_collector_go()
        launcher = Launcher(device, threads, wait_for_kernels=wait_for_kernels)
        host_cache = HostCache(neighbours, scene, in_main_memory=device == "cpu")
        return CellWorker(number, world, partition, holders, launcher, host_cache)

    line = line_to_watch(sys.stdin.buffer) if life_line else None
    try:
        run_slave(
            master,
            make_worker,
            threads=threads or available_cores(),
            memory=memory,
            security=security,
            patience=patience,
            rejoin=rejoin,
            life_line=line,
            tell_scene=tell_scene,
        )
    finally:
        if line is not None and local_sockets.is_local(master) and has_ended(line):
            local_sockets.leave_orphaned(master)


def fork_slaves(master: str) -> bool:
    """Have slaves forked from this process, see serve_forks, which says whether this is one of them.

    Whatever has become of a master of this machine and its slaves, the process that they were forked from sees the last
    of them end: it clears away what they have left if the master was killed.

    Args:
        master: address, see serve.
    """
    from wdpm.cluster.transport.fork_server import serve_forks

    started_by = os.getppid()
    load_ahead()
    if serve_forks():
        return True
    if local_sockets.is_local(master) and os.getppid() != started_by:
        local_sockets.leave_orphaned(master, last=True)
    return False


def load_ahead() -> None:
    """Do what each slave must before there is work: imports, versions, codecs of messages, kernels of all scenes.

    For a process that slaves are forked from. What fails here fails in each of them as well, which tells the master.
    """
    import numpy.ma  # noqa: F401 - numpy.unique does

    from wdpm.cluster.messages import packing, protocol
    from wdpm.cluster.transport.zeromq import network  # noqa: F401
    from wdpm.cluster.versions import versions
    from wdpm.cluster.work import worker  # noqa: F401
    from wdpm.kernels.compile import load_compiled

    with contextlib.suppress(OSError, RuntimeError, WdpmError):
        versions()
        packing.prepare(protocol.Message)
        quiet_warp()
        load_compiled()


def _prepare(device: str) -> None:
    """Load Warp and the kernels of all scenes; MachineError if that cannot be, whatever is rendered."""
    from wdpm.kernels.compile import compile_kernels

    try:
        quiet_warp()
        compile_kernels(device)
    except (OSError, RuntimeError, SettingsError) as error:
        raise MachineError(f"it is not fit to compute: {error}") from None


def limit_memory(limit: int) -> None:
    """Have allocations fail beyond a limit [bytes], instead of the machine beginning to swap."""
    try:
        import resource
    except ModuleNotFoundError:
        raise SettingsError("--memory: this system cannot limit the memory of a process; leave it out") from None
    try:
        # Data, not address space: threads and compiled code reserve far more addresses than they use.
        resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
    except (ValueError, OSError) as error:
        raise SettingsError(f"cannot limit memory to {limit} bytes: {error}") from None
