"""A cluster on this machine whose slaves compute on different devices."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack

from wdpm.cluster.master.local_slaves import LocalSlaves, slave_command
from wdpm.cluster.master.server import MasterServer
from wdpm.cluster.plan.copies import Sharing
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.session import Session, SessionResult
from wdpm.cluster.transport.zeromq.run_keys import RunKeys
from wdpm.kernels.launch import Launcher
from wdpm.progress import Progress
from wdpm.rendering.backend import Backend
from wdpm.rendering.prepare import Prepared, Source, prepare


class MixedCluster(Backend):
    """A master here, which flies the pilot on the CPU, and a slave process for each device.

    Args:
        devices: Warp's names.
        threads: cores to use in all, shared out among the slaves.
    """

    def __init__(self, devices: Sequence[str], threads: int) -> None:
        super().__init__(slaves=len(devices), threads=threads, device="cpu")
        with ExitStack() as stack:
            processes = LocalSlaves()
            stack.callback(processes.stop)
            keys = RunKeys()  # other people of this machine reach its ports, too
            server = MasterServer("tcp://127.0.0.1:0", len(devices), security=keys.master, watch=processes.ended)
            self._master = stack.enter_context(server)
            for device in devices:
                command = slave_command(max(1, threads // len(devices)), device)
                processes.start(1, command, self._master.endpoint, keys.for_slave)
            self._stack = stack.pop_all()

    def prepare(self, source: Source, settings: RenderSettings, progress: Progress) -> Prepared:
        return prepare(
            source,
            settings,
            self.slaves,
            Launcher("cpu", self.threads),
            progress,
            team=lambda _: Sharing(self.slaves, 1),
        )

    def run(self, prepared: Prepared, session: Session, progress: Progress) -> SessionResult:  # noqa: ARG002
        return self._master.render(session, progress)

    def close(self) -> None:
        self._stack.close()
