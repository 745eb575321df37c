"""Clusters for people: `wdpm.Cluster`, and what `wdpm master` and `wdpm slave` run."""

from __future__ import annotations

import resource
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from wdpm.cluster.master.local_slaves import LocalSlaves, slave_command
from wdpm.cluster.master.server import MasterServer, nobody
from wdpm.cluster.session import Session, SessionResult
from wdpm.cluster.slave.process import PATIENCE_S, run_slave
from wdpm.cluster.transport import address
from wdpm.cluster.transport.zeromq.key_files import keys_for
from wdpm.devices import available_cores, check_device
from wdpm.progress import Progress
from wdpm.scenes.errors import SettingsError

if TYPE_CHECKING:
    from wdpm.cluster.render_settings import RenderSettings
    from wdpm.cluster.slave.jobs import Worker
    from wdpm.cluster.world import World
    from wdpm.images.image import Image
    from wdpm.rendering.prepare import Prepared, Source
    from wdpm.scenes.flat.arrays import Triangles
    from wdpm.scenes.model.scene import Scene


class Cluster:
    """A master here, and slaves that stay up for many renders.

    Geometry is sent and photons are traced once for all renders that differ by no more than the camera and what
    belongs to it.

        with wdpm.Cluster.local(slaves=4) as cluster:
            image = cluster.render(wdpm.load("scene.xml"))

    Use `local` or `listen` to make one.
    """

    def __init__(
        self, master: MasterServer, slaves: int, stack: ExitStack, *, threads: int | None = None, device: str = "cpu"
    ) -> None:
        self._master = master
        self._stack = stack
        self._threads = threads
        self._device = device
        self.slaves = slaves

    @classmethod
    def local(cls, slaves: int, *, threads: int | None = None, device: str = "cpu") -> Self:
        """Start slave processes on this machine.

        Args:
            slaves: how many.
            threads: cores to use in all, shared out among the slaves; None for all there are.
            device: that they compute on.
        """
        if slaves < 1:
            raise SettingsError(f"slaves is {slaves}; expected at least 1")
        check_device(device)
        each = max(1, (threads or available_cores()) // slaves)
        with ExitStack() as stack:
            processes = LocalSlaves()
            stack.callback(processes.stop)
            master = stack.enter_context(MasterServer("tcp://127.0.0.1:0", slaves, watch=processes.ended))
            processes.start(slaves, slave_command(each, device), master.endpoint)
            return cls(master, slaves, stack.pop_all(), threads=threads, device=device)

    @classmethod
    def listen(cls, bind: str, slaves: int, *, keys: Path | None = None, insecure: bool = False) -> Self:
        """Wait for slaves that people start with `wdpm slave`.

        Args:
            bind: tcp://HOST:PORT to listen at.
            slaves: how many to wait for.
            keys: folder that `wdpm keys` made; needed unless only this machine can reach HOST ...
            insecure: ... or anyone may take part.

        Raises:
            SettingsError: neither keys nor insecure where one is needed, or the keys cannot be read.
            ClusterError: it cannot listen there.
        """
        security = keys_for(address.resolve(bind), keys, insecure)
        with ExitStack() as stack:
            master = stack.enter_context(MasterServer(bind, slaves, security=security, watch=nobody))
            return cls(master, slaves, stack.pop_all())

    @property
    def endpoint(self) -> str:
        """Where slaves find the master."""
        return self._master.endpoint

    def run(self, session: Session, progress: Progress | None = None) -> SessionResult:
        """Render a session; ClusterError if the cluster ends because of an error."""
        return self._master.render(session, progress)

    def prepare(self, scene: Scene, settings: RenderSettings, progress: Progress, cells: int | None = None) -> Prepared:
        """Make a scene ready for these slaves; see prepare.prepare."""
        from wdpm.kernels.launch import Launcher
        from wdpm.rendering.prepare import prepare

        return prepare(scene, settings, self.slaves, Launcher(self._device, self._threads), progress, cells)

    def render(
        self,
        source: Source,
        settings: RenderSettings | None = None,
        *,
        progress: Progress | None = None,
        journal: Path | None = None,
        resume: bool = False,
        keep: bool = False,
        save_cache: Path | None = None,
        load_cache: Path | None = None,
        **chosen: Any,
    ) -> Image:
        """Render a scene: the same bits as `wdpm.render`.

        Args:
            source: a scene, a file, the name of a built-in scene, or a function that gives a scene.
            settings: all settings; or give single ones by name, see RenderSettings.
            journal, resume, keep: of a render in several passes, see `wdpm.render`.
            save_cache, load_cache: files of irradiance records, see `wdpm.render`.

        Raises:
            SceneError, SettingsError: see their messages.
            ClusterError: a slave failed or was lost; the cluster has ended.
        """
        from wdpm.rendering.cache_file import CacheFiles
        from wdpm.rendering.passes import render_in_passes

        return render_in_passes(
            source,
            settings,
            cluster=self,
            progress=progress,
            journal=journal,
            resume=resume,
            keep=keep,
            cache=CacheFiles(save_cache, load_cache),
            **chosen,
        )

    def close(self) -> None:
        """Stop the slaves; may be called again."""
        self._stack.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # The master tells the slaves why it ends, so it must hear of the error.
        self._stack.__exit__(kind, error, trace)


def render_as_master(
    source: Source,
    settings: RenderSettings,
    *,
    bind: str,
    slaves: int,
    keys: Path | None,
    insecure: bool,
    progress: Progress | None,
    journal: Path | None = None,
    resume: bool = False,
    keep: bool = False,
    save_cache: Path | None = None,
    load_cache: Path | None = None,
) -> Image:
    """What `wdpm master` does: one render with slaves that people start."""
    with Cluster.listen(bind, slaves, keys=keys, insecure=insecure) as cluster:
        return cluster.render(
            source,
            settings,
            progress=progress,
            journal=journal,
            resume=resume,
            keep=keep,
            save_cache=save_cache,
            load_cache=load_cache,
        )


def serve_as_slave(
    master: str,
    *,
    threads: int | None = None,
    device: str = "cpu",
    memory: int | None = None,
    keys: Path | None = None,
    insecure: bool = False,
    patience: float = PATIENCE_S,
    life_line: bool = False,
) -> None:
    """What `wdpm slave` does: compute for a master until it says stop.

    Args:
        master: tcp://HOST:PORT.
        memory: most memory to use [bytes]; None for no limit.
        patience: how long to wait for the master's first answer [s].
        life_line: end when standard input closes, which the process that started this one holds open.

    Raises:
        SettingsError: the keys cannot be read, or the device is not there.
        ClusterError: no master answered, it refused, or something failed.
    """
    if device != "cpu":
        from wdpm.quiet import quiet_warp

        quiet_warp()
        check_device(device)
    security = keys_for(address.resolve(master), keys, insecure)
    if memory is not None:
        limit_memory(memory)

    def make_worker(number: int, world: World, partition: Mapping[int, Triangles], holders: Sequence[int]) -> Worker:
        # Warp takes half a second to import: a slave that cannot join should say so at once.
        from wdpm.cluster.work.worker import CellWorker
        from wdpm.kernels.compile import compile_kernels
        from wdpm.kernels.launch import Launcher
        from wdpm.quiet import quiet_warp

        quiet_warp()
        compile_kernels(device)
        return CellWorker(number, world, partition, holders, Launcher(device, threads))

    run_slave(
        master,
        make_worker,
        threads=threads or available_cores(),
        memory=memory,
        security=security,
        patience=patience,
        life_line=sys.stdin.fileno() if life_line else None,
    )


def limit_memory(limit: int) -> None:
    """Have allocations fail beyond a limit [bytes], instead of the machine beginning to swap."""
    try:
        # Data, not address space: threads and compiled code reserve far more addresses than they use.
        resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
    except (ValueError, OSError) as error:
        raise SettingsError(f"cannot limit memory to {limit} bytes: {error}") from None
