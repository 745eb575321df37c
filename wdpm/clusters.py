"""Clusters for people: `wdpm.Cluster`."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from numbers import Real
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from wdpm.cluster.cluster_events import ClusterObserver
from wdpm.cluster.host_memory import SlaveMemory
from wdpm.cluster.limits import MOST_SLAVES, ClusterLimits
from wdpm.cluster.master.local_slaves import LocalSlaves, slave_command
from wdpm.cluster.master.server import MasterServer
from wdpm.cluster.plan.copies import Copies, copies_named, sharing
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.session import Session, SessionResult
from wdpm.cluster.transport import address, local_sockets
from wdpm.cluster.transport.registry import transport_of
from wdpm.cluster.transport.transport import Role
from wdpm.devices import available_cores, check_count, check_device, check_memory, check_threads
from wdpm.images.image import Image
from wdpm.kernels.launch import Launcher
from wdpm.notebook import shown_live
from wdpm.placing.hosts import read_hosts
from wdpm.placing.own_address import address_towards, listening_address, reached_at
from wdpm.placing.placed_slaves import PlacedSlaves
from wdpm.placing.slurm import Allocation, other_nodes
from wdpm.placing.ssh_slaves import JOIN_TIMEOUT_S as SSH_JOIN_TIMEOUT_S
from wdpm.placing.ssh_slaves import SshSlaves
from wdpm.progress import Progress
from wdpm.rendering.backend import Backend
from wdpm.rendering.cache_file import CacheFiles, path_named
from wdpm.rendering.compiling import Compiling
from wdpm.rendering.kernels_beside import KernelsBeside
from wdpm.rendering.passes import render_in_passes
from wdpm.rendering.prepare import Prepared, Source, forget_pilot, prepare
from wdpm.scenes.errors import SettingsError

if TYPE_CHECKING:
    from wdpm.cluster.transport.keys import Keys
    from wdpm.cluster.transport.zeromq.run_keys import RunKeys
    from wdpm.placing.dask_slaves import DaskSlaves

JOIN_TIMEOUT_S = ClusterLimits().join_timeout_s


class Cluster(Backend):
    """A master here, and slaves that stay up for many renders.

    Geometry is sent and photons are traced once for all renders that differ by no more than the camera and what
    belongs to it.

        with wdpm.Cluster.local(slaves=4) as cluster:
            image = cluster.render(wdpm.load("scene.xml"))

    Use `local` or `listen` to make one.
    """

    def __init__(
        self,
        master: MasterServer,
        slaves: int,
        stack: ExitStack,
        *,
        copies: Copies = Copies.AUTO,
        processes: LocalSlaves | None = None,
        placed: PlacedSlaves | None = None,
        threads: int | None = None,
        device: str = "cpu",
        compiling: Compiling = Compiling.FIRST,
    ) -> None:
        super().__init__(slaves=slaves, threads=threads or available_cores(), device=device)
        self._master = master
        self._stack = stack
        self._copies = copies
        self._processes = processes
        self._placed = placed
        self._launcher = Launcher(device, threads, wait_for_kernels=compiling is Compiling.FIRST)
        self._beside = KernelsBeside(compiling)
        self._one_at_a_time = threading.Lock()
        stack.callback(self._beside.leave)

    @classmethod
    def local(
        cls,
        slaves: int,
        *,
        copies: Copies | str = Copies.AUTO,
        memory: int | None = None,
        threads: int | None = None,
        device: str = "cpu",
        observers: Sequence[ClusterObserver] = (),
        compiling: Compiling = Compiling.FIRST,
    ) -> Self:
        """Start slave processes on this machine.

        Args:
            slaves: how many.
            copies: "auto" or "none": whether each may hold what others hold, too.
            memory: most that each may use [bytes]; None for its part of half the machine's.
            threads: cores to use in all, shared out among the slaves; None for all there are.
            device: that they compute on.
            observers: are told what happens to the cluster, on a thread of its own.
            compiling: when a scene's kernels are compiled, if they have not been.
        """
        check_count("slaves", slaves)
        check_threads(threads)
        check_memory(memory, slaves)
        check_device(device)
        copies = copies_named(copies)
        each = max(1, (threads or available_cores()) // slaves)
        with ExitStack() as stack:
            processes = LocalSlaves()
            here = stack.enter_context(local_sockets.address_for_master())
            stack.callback(processes.stop)
            keys = None if here else _run_keys()  # other people of this machine reach its ports, too
            server = MasterServer(
                here or "tcp://127.0.0.1:0",
                slaves,
                security=None if keys is None else keys.master,
                watch=processes.ended,
                observers=observers,
            )
            master = stack.enter_context(server)
            first = compiling is Compiling.FIRST
            command = slave_command(each, device, memory, keyed=keys is not None, wait_for_kernels=first)
            lines = bytes if keys is None else keys.for_slave
            processes.start(slaves, command, master.endpoint, lines, forked=device == "cpu")
            return cls(
                master,
                slaves,
                stack.pop_all(),
                copies=copies,
                processes=processes,
                threads=threads,
                device=device,
                compiling=compiling,
            )

    @classmethod
    def listen(
        cls,
        bind: str,
        slaves: int,
        *,
        most: int | None = None,
        copies: Copies | str = Copies.AUTO,
        keys: str | PathLike[str] | None = None,
        insecure: bool = False,
        join_timeout: float = JOIN_TIMEOUT_S,
        observers: Sequence[ClusterObserver] = (),
    ) -> Self:
        """Wait for slaves that people start with `wdpm slave`.

        Args:
            bind: tcp://HOST:PORT to listen at.
            slaves: how many to wait for.
            most: how many there may be at a time, so that more may join later; None for no more.
            copies: "auto" or "none": whether each may hold what others hold, too.
            keys: the master's folder, that `wdpm keys` made; needed unless only this machine can reach HOST ...
            insecure: ... or anyone may take part.
            join_timeout: how long a render waits for slaves that have not joined [s].
            observers: are told what happens to the cluster, on a thread of its own.

        Raises:
            SettingsError: no slave, fewer at most than are waited for, neither keys nor insecure where one is needed,
                or the keys cannot be read.
            ClusterError: it cannot listen there.
        """
        if not isinstance(bind, str):
            raise SettingsError(f"bind is {bind!r}; expected an address, like 'tcp://127.0.0.1:7117'")
        check_count("slaves", slaves)
        if most is not None:
            check_count("most", most)
            if most < slaves:
                raise SettingsError(f"most is {most}; expected at least as many as slaves, which is {slaves}")
        copies = copies_named(copies)
        security = _keys_for(bind, path_named(keys), insecure)
        with ExitStack() as stack:
            limits = _limits(join_timeout)
            server = MasterServer(bind, slaves, most=most, security=security, limits=limits, observers=observers)
            return cls(stack.enter_context(server), slaves, stack.pop_all(), copies=copies)

    @classmethod
    def in_slurm(
        cls,
        allocation: Allocation,
        shared: Path,
        *,
        copies: Copies | str = Copies.AUTO,
        join_timeout: float = JOIN_TIMEOUT_S,
        observers: Sequence[ClusterObserver] = (),
    ) -> Self:
        """Be the master of a Slurm step, whose other tasks are the slaves.

        Args:
            allocation: what Slurm gives this process, task 0 of the step.
            shared: a directory that all nodes of the step share, where master and slaves find each other.
            copies: "auto" or "none": whether each may hold what others hold, too.
            join_timeout: how long a render waits for slaves that have not joined [s].
            observers: are told what happens to the cluster, on a thread of its own.

        Raises:
            SettingsError: nothing can be written there, or the other nodes cannot be found.
        """
        slaves = allocation.tasks - 1
        copies = copies_named(copies)
        number = address_towards(other_nodes(allocation))
        with ExitStack() as stack:
            from wdpm.placing.rendezvous import Rendezvous, meeting_folder  # needs ZeroMQ

            rendezvous = Rendezvous(meeting_folder(shared, allocation.name), slaves)
            stack.callback(rendezvous.close, "its render is over")
            bind = listening_address(number)
            limits = _limits(join_timeout)
            server = MasterServer(bind, slaves, security=rendezvous.security, limits=limits, observers=observers)
            master = stack.enter_context(server)
            rendezvous.publish(reached_at(number, master.endpoint))
            return cls(master, slaves, stack.pop_all(), copies=copies, threads=allocation.threads)

    @classmethod
    def on_dask(
        cls,
        client: Any,
        slaves: int | None = None,
        *,
        copies: Copies | str = Copies.AUTO,
        device: str = "cpu",
        join_timeout: float = JOIN_TIMEOUT_S,
        observers: Sequence[ClusterObserver] = (),
    ) -> Self:
        """Have slaves on the workers of a Dask cluster: one on each, with its threads and its memory.

        A render begins when there is a slave on each of the workers that are there now, or on `slaves` of them. Workers
        that come later, or in the place of lost ones, get slaves as well. Each worker must have the same wdpm.

        Args:
            client: a `distributed.Client`, which stays open; not an asynchronous one.
            slaves: most at a time; None for one on each worker, however many come.
            copies: "auto" or "none": whether each may hold what others hold, too.
            device: that slaves compute on.
            join_timeout: how long a render waits for slaves that have not joined [s].
            observers: are told what happens to the cluster, on a thread of its own.

        Raises:
            SettingsError: wdpm's extra `dask` is not installed, or this is no such client.
            ClusterError: it cannot listen.
        """
        dask_slaves = _dask_slaves()
        if slaves is not None:
            check_count("slaves", slaves)
        most = MOST_SLAVES if slaves is None else slaves
        placed = dask_slaves(client, most, device)
        first = min(most, max(1, len(placed.workers())))
        return cls._with_slaves(placed, first, most, copies, join_timeout, observers)

    @classmethod
    def over_ssh(
        cls,
        hosts: Sequence[str],
        *,
        copies: Copies | str = Copies.AUTO,
        memory: int | None = None,
        threads: int | None = None,
        device: str = "cpu",
        remote_wdpm: str = "wdpm",
        join_timeout: float = SSH_JOIN_TIMEOUT_S,
        observers: Sequence[ClusterObserver] = (),
    ) -> Self:
        """Start slaves on other machines by OpenSSH's client, which must not have to ask for anything.

        A slave that ends before all have joined is not waited for, unless none is left. It is started again after
        a while, and so are those that are lost later.

        Args:
            hosts: NAME, USER@NAME or, with a number of slaves, NAME:2; names as ssh's configuration has them.
            copies: "auto" or "none": whether each may hold what others hold, too.
            memory: most that each may use [bytes].
            threads: of each; None for all cores there, shared out among the slaves of a host.
            device: that they compute on.
            remote_wdpm: the program `wdpm` on those machines.
            join_timeout: how long a render waits for slaves that have not joined [s].
            observers: are told what happens to the cluster, on a thread of its own.

        Raises:
            SettingsError: a host cannot be found, or is none.
            ClusterError: it cannot listen.
        """
        if threads is not None:
            check_count("threads", threads)
        if memory is not None:
            check_count("memory", memory)
        for name, word in (("device", device), ("remote_wdpm", remote_wdpm)):
            if not isinstance(word, str):
                raise SettingsError(
                    f"{name} is {word!r}; expected a word, like {'cpu' if name == 'device' else 'wdpm'!r}"
                )
        slaves = SshSlaves(read_hosts(hosts), remote_wdpm, threads=threads, memory=memory, device=device)
        return cls._with_slaves(slaves, len(slaves), len(slaves), copies, join_timeout, observers)

    @classmethod
    def _with_slaves(
        cls,
        placed: PlacedSlaves,
        first: int,
        most: int,
        copies: Copies | str,
        join_timeout: float,
        observers: Sequence[ClusterObserver],
    ) -> Self:
        """Listen, and have slaves placed, with keys of the run."""
        copies = copies_named(copies)
        with ExitStack() as stack:
            stack.callback(placed.stop)
            keys = _run_keys()
            server = MasterServer(
                placed.listen_at,
                first,
                most=most,
                security=keys.master,
                limits=_limits(join_timeout),
                watch=placed.ended,
                observers=observers,
            )
            master = stack.enter_context(server)
            stack.callback(placed.no_more)
            placed.start(master.endpoint, keys.for_slave)
            return cls(master, first, stack.pop_all(), copies=copies, placed=placed)

    @property
    def processes(self) -> tuple[int, ...]:
        """Process numbers of slaves that were started here, and have not ended."""
        return () if self._processes is None else tuple(self._processes.processes)

    @property
    def endpoint(self) -> str:
        """Where slaves find the master."""
        return self._master.endpoint

    def prepare(self, source: Source, settings: RenderSettings, progress: Progress) -> Prepared:
        """Make a scene ready for these slaves; the pilot is flown here."""
        slaves = [SlaveMemory(hello.host, hello.memory, hello.own_memory) for hello in self._master.slaves(progress)]
        if self._placed is not None:
            self._placed.all_joined()
        team = partial(sharing, self._copies, slaves)
        neighbours = local_sockets.shared_with(self._master.endpoint)
        prepared = prepare(source, settings, len(slaves), self._launcher, progress, team=team, neighbours=neighbours)
        forget_pilot(prepared)
        self._beside.compile(prepared.uncompiled, progress.note)
        return prepared

    def run(self, prepared: Prepared, session: Session, progress: Progress) -> SessionResult:  # noqa: ARG002
        """Render a session. What slaves have of it already they are not sent again, nor do they trace it again."""
        self._beside.before_pass()
        try:
            return self._master.render(session, progress, self.display, self.keeper)
        except BaseException:
            self._beside.stop()
            raise

    def render(
        self,
        source: Source,
        settings: RenderSettings | None = None,
        *,
        progress: Progress | None = None,
        live: bool = False,
        journal: str | PathLike[str] | None = None,
        resume: bool = False,
        keep: bool = False,
        save_cache: str | PathLike[str] | None = None,
        load_cache: str | PathLike[str] | None = None,
        **chosen: Any,
    ) -> Image:
        """Render a scene: the same bits as `wdpm.render`. Threads that ask at once are served one after the other.

        Args:
            source: a scene, a file, the name of a built-in scene, or a function that gives a scene.
            settings: all settings; or give single ones by name, see RenderSettings.
            live: show it in the notebook that this runs in, see `wdpm.render`.
            journal, resume, keep: of a render that may be interrupted, see `wdpm.render`.
            save_cache, load_cache: files of irradiance records, see `wdpm.render`.

        Raises:
            SceneError, SettingsError: see their messages.
            ClusterError: a slave failed, or all were lost; the cluster has ended.
        """
        with self._one_at_a_time, self._shown(live, source, progress) as (scene, live_progress):
            return render_in_passes(
                scene,
                self,
                settings,
                progress=live_progress,
                journal=path_named(journal),
                resume=resume,
                keep=keep,
                cache=CacheFiles.named(save_cache, load_cache),
                **chosen,
            )

    @contextmanager
    def _shown(self, live: bool, source: Source, progress: Progress | None) -> Iterator[tuple[Source, Progress | None]]:
        """A display of the notebook beside the cluster's own, for one render."""
        display = self.display
        with shown_live(live, source, display, progress) as (scene, self.display, live_progress):
            try:
                yield scene, live_progress
            finally:
                self.display = display

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


def _limits(join_timeout: float) -> ClusterLimits:
    """Those of a cluster that waits so long for slaves [s]; SettingsError for what is no time."""
    if not isinstance(join_timeout, Real) or isinstance(join_timeout, bool) or not join_timeout > 0.0:
        raise SettingsError(f"join_timeout is {join_timeout!r}; expected seconds above 0")
    return ClusterLimits(join_timeout_s=float(join_timeout))


def _run_keys() -> RunKeys:
    from wdpm.cluster.transport.zeromq.run_keys import RunKeys  # a render without slaves needs no ZeroMQ

    return RunKeys()


def _keys_for(bind: str, keys: Path | None, insecure: bool) -> Keys | None:
    from wdpm.cluster.transport.zeromq.key_files import keys_for

    return keys_for(address.resolve(bind), keys, insecure, Role.MASTER)


def _dask_slaves() -> type[DaskSlaves]:
    try:
        from wdpm.placing.dask_slaves import DaskSlaves
    except ModuleNotFoundError as error:
        raise SettingsError(f"Dask needs the extra: pip install 'wdpm[dask]' ({error})") from None
    return DaskSlaves


def check_listening(bind: str, keys: Path | None, insecure: bool) -> None:
    """Find out before a scene is loaded whether a master could listen: the errors of `Cluster.listen`.

    No master answers meanwhile: a slave that waits for one tries again.
    """
    network = transport_of(bind).open(_keys_for(bind, keys, insecure))
    try:
        network.listen(bind, Role.MASTER, {})
    finally:
        network.close()
