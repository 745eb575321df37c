"""Who computes: the one door between what is to be rendered and the processes that render it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, Self

from wdpm.cluster.display import Display
from wdpm.cluster.kept import Keeper
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.session import Session, SessionResult
from wdpm.given import check_follows
from wdpm.progress import Progress

if TYPE_CHECKING:  # it needs Warp, which a command that is only asked for help does not import
    from wdpm.rendering.prepare import Prepared, Source


class Backend(ABC):
    """Renders sessions, wherever its workers are. A context manager.

    All backends give the same bits (docs/exactness.md), so whoever renders is handed one and need not know which; who
    made it closes it. Scenes are rendered one after the other: what was prepared last is what sessions are run of.

    Args:
        slaves: processes that compute in place of this one; 0 where this one does.
        threads: cores of this machine that may be used in all.
        device: that kernels run on: "cpu" or a CUDA device, "cuda:0".

    Attributes:
        keeps_scene: whether geometry and photons of the last scene stay for the next one, which has them if no more
            than the camera moved. A cluster's slaves keep theirs in any case.
        keeper: is given what is finished of a session as it comes; None where nobody keeps it.
    """

    def __init__(self, *, slaves: int, threads: int, device: str) -> None:
        self.slaves = slaves
        self.threads = threads
        self.device = device
        self._display: Display | None = None
        self.keeps_scene = False
        self.keeper: Keeper | None = None

    @property
    def display(self) -> Display | None:
        """Is shown images while they are rendered; None where nobody looks. SettingsError for what is no display."""
        return self._display

    @display.setter
    def display(self, display: Display | None) -> None:
        check_follows("display", display, Display)
        self._display = display

    @property
    def processes(self) -> tuple[int, ...]:
        """Process numbers of slaves that were started here."""
        return ()

    @abstractmethod
    def prepare(self, source: Source, settings: RenderSettings, progress: Progress) -> Prepared:
        """Make a scene ready for the workers that there are.

        Raises:
            SettingsError, GuardError: as `wdpm.rendering.prepare.prepare`.
        """

    @abstractmethod
    def run(self, prepared: Prepared, session: Session, progress: Progress) -> SessionResult:
        """Render a session of a scene that this backend prepared.

        Args:
            session: `prepared.session`, or what was made of it: another view, other photons, records.

        Raises:
            ClusterError: a worker failed or was lost; the backend can only be closed then.
        """

    @abstractmethod
    def close(self) -> None:
        """Let go of all workers; may be called again."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


Backends = Callable[[int], Backend]
"""Makes a backend with a number of slaves, 0 for this process; for what compares several of them."""


class ClusterBackends(Protocol):
    """Makes a backend of slaves with some threads in all, each of which may use so much memory [bytes]."""

    def __call__(
        self, slaves: int, copies: Copies = ..., threads: int | None = ..., memory: int | None = ..., /
    ) -> Backend: ...
