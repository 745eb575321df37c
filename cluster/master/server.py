"""A master that slaves reach at an address.

A thread owns the network and the state, so that heartbeats go on while the caller computes a partition, or thinks.
Partitions and progress are the caller's thread's business: `render` waits there, and Ctrl-C reaches it.
"""

from __future__ import annotations

import platform
import queue
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from types import TracebackType
from typing import Self

from wdpm.cluster.cluster_events import ClusterObserver
from wdpm.cluster.display import Display
from wdpm.cluster.kept import Keeper
from wdpm.cluster.limits import ClusterLimits, check_most_slaves
from wdpm.cluster.master import events as m
from wdpm.cluster.master.loop import FROM_SLAVE, MasterLoop, Started, Watch
from wdpm.cluster.master.machine import Master
from wdpm.cluster.master.observing import tell_display, tell_keeper, tell_observer
from wdpm.cluster.messages import protocol
from wdpm.cluster.progress import ProgressObserver
from wdpm.cluster.session import Session, SessionResult
from wdpm.cluster.transport import open_files
from wdpm.cluster.transport.keys import Keys
from wdpm.cluster.transport.mailbox import Mailbox
from wdpm.cluster.transport.registry import transport_of
from wdpm.cluster.transport.transport import Role
from wdpm.cluster.versions import versions
from wdpm.scenes.errors import ClusterError, SettingsError
from wdpm.scenes.meshes.several import available_cores

PULSE_S = 0.2
"""Between one word to an observer and the next, while nothing comes."""

CLOSED = "the cluster has been closed; start another"


def nobody() -> Iterable[Started]:
    """Watches no process."""
    return ()


class MasterServer:
    """A master that listens at an address; renders any number of sessions with the slaves that join.

    Args:
        listen_at: an address of any transport, tcp://HOST:PORT say; port 0 takes a free one.
        slaves: how many it waits for.
        most: slaves that may be there at a time; None for no more than it waits for.
        security: keys of the cluster, or None.
        watch: tells of slave processes that were started here and have ended.
        agreed: what slaves must have in common with it; None for this process's versions.
        observers: are told what happens to the cluster, on a thread of the master's own.

    Raises:
        SettingsError: more slaves than can be, or than this process may have connections with.
        ClusterError: it cannot listen there.
    """

    def __init__(
        self,
        listen_at: str,
        slaves: int,
        *,
        most: int | None = None,
        security: Keys | None = None,
        limits: ClusterLimits | None = None,
        watch: Watch = nobody,
        agreed: Mapping[str, str] | None = None,
        observers: Sequence[ClusterObserver] = (),
    ) -> None:
        if not isinstance(observers, Sequence) or not all(map(callable, observers)):
            raise SettingsError(f"observers is {observers!r:.80}; expected functions, which are told of events")
        together = max(slaves, most or 0)
        check_most_slaves(together)
        open_files.require(together)
        self._slaves = slaves
        self._noted_wait = False
        self._closed = False
        self._answers: queue.SimpleQueue[m.Instruction | BaseException] = queue.SimpleQueue()
        self._stack = ExitStack()
        try:
            network = transport_of(listen_at).open(security)
            self._stack.callback(network.close)
            listener = network.listen(listen_at, Role.MASTER, FROM_SLAVE)
            self.endpoint = listener.endpoint
            self._mailbox = Mailbox()
            self._stack.callback(self._mailbox.close)
            here = {platform.node(): available_cores()}
            state = Master(slaves, versions() if agreed is None else agreed, limits, most, here)
            self._loop = MasterLoop(state, network, listener, self._mailbox, watch, self._answers, observers, limits)
            self._thread = threading.Thread(target=self._loop.run, name="wdpm master", daemon=True)
            self._thread.start()
        except BaseException:
            self._stack.close()
            raise

    @property
    def dropped(self) -> dict[str, int]:
        """Messages that were not used so far, by reason."""
        return self._loop.state.dropped

    def slaves(self, progress: ProgressObserver | None = None) -> tuple[protocol.Hello, ...]:
        """The slaves that are there, once all have joined that it waits for.

        Raises:
            ClusterError: the cluster has ended because of an error, and cannot be used any more.
        """
        with self._interruptible():
            self._tell_to_wait(progress)
            self._mailbox.put(m.WaitForSlaves())
            joined = self._follow(None, progress, None)
        if not isinstance(joined, m.AllJoined):
            raise AssertionError("a session ended before it began")
        return joined.slaves

    def render(
        self,
        session: Session,
        progress: ProgressObserver | None = None,
        display: Display | None = None,
        keeper: Keeper | None = None,
    ) -> SessionResult:
        """Render a session as soon as all slaves have joined.

        Args:
            keeper: is given what is finished as it comes.

        Raises:
            ClusterError: the cluster has ended because of an error, and cannot be used any more.
        """
        with self._interruptible():
            self._tell_to_wait(progress)
            self._mailbox.put(m.Begin(session))
            finished = self._follow(session, progress, display, keeper)
        if not isinstance(finished, m.Finished):
            raise AssertionError("a session ended without a result")
        return finished.result

    @contextmanager
    def _interruptible(self) -> Iterator[None]:
        """Whatever is raised meanwhile ends the cluster."""
        if self._closed:
            raise ClusterError(CLOSED)
        try:
            yield
        except BaseException as error:
            self._interrupt(error)
            raise

    def _tell_to_wait(self, progress: ProgressObserver | None) -> None:
        if progress is not None and not self._noted_wait:
            self._noted_wait = True
            progress.note(f"waiting for {self._slaves} slave{'s' * (self._slaves != 1)} at {self.endpoint}")

    def _follow(
        self,
        session: Session | None,
        progress: ProgressObserver | None,
        display: Display | None,
        keeper: Keeper | None = None,
    ) -> m.Finished | m.AllJoined:
        while True:
            answer = self._next_answer(progress)
            tell_display(answer, display)
            tell_keeper(answer, keeper)
            match answer:
                case m.Finished() | m.AllJoined():
                    return answer
                case m.Broken(reason):
                    raise ClusterError(reason)
                case m.MakePartition(cell) if session is not None:
                    self._mailbox.put(m.PartitionMade(cell, session.partition(cell)))
                case BaseException() as error:
                    raise error
                case m.Send():
                    raise AssertionError("the loop sends by itself")
                case other:
                    tell_observer(other, progress)

    def _next_answer(self, progress: ProgressObserver | None) -> m.Instruction | BaseException:
        """What the loop says next. An observer hears of no progress meanwhile, so that one that wants the render to end
        can raise: slaves that are waited for may never join."""
        while True:
            try:
                return self._answers.get(timeout=PULSE_S)
            except queue.Empty:
                if self._closed:  # by another thread, and nobody answers any more
                    raise ClusterError(CLOSED) from None
                if progress is not None:
                    progress.advance(0)

    def _interrupt(self, error: BaseException) -> None:
        self.close(f"the master was interrupted ({type(error).__name__})", completed=False)

    def close(self, reason: str = "all is rendered", *, completed: bool = True) -> None:
        """Have all slaves stop, and let go of the network; may be called again.

        Args:
            completed: whether all that was to be rendered is; slaves end with an error otherwise.
        """
        if self._closed:
            return
        self._closed = True
        if self._thread.is_alive():
            self._mailbox.put(m.Close(reason, completed))
            self._thread.join()
        self._stack.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
        else:
            self._interrupt(error)
