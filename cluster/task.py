"""Units of work that the master hands out, and what comes back."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.records import Records


@dataclass(frozen=True)
class PhotonTask:
    """Trace the photon paths start to stop - 1."""

    number: int
    start: int
    stop: int


@dataclass(frozen=True)
class BucketTask:
    """Render all samples of the pixels x0 <= x < x1, y0 <= y < y1."""

    number: int
    x0: int
    y0: int
    x1: int
    y1: int


@dataclass(frozen=True, eq=False)
class RecordTask:
    """Make the irradiance records of the candidates start to stop - 1 of a round: cluster.records.

    Attributes:
        some: of these the ones that are meant, ascending, int32; none for all of them.
    """

    number: int
    round: int
    start: int
    stop: int
    some: NDArray[np.int32] = field(default_factory=lambda: np.empty(0, np.int32))

    @property
    def count(self) -> int:
        """How many candidates there are."""
        return len(self.some) or self.stop - self.start

    @property
    def candidates(self) -> NDArray[np.int32]:
        """Their places among those of the round, ascending."""
        return self.some if len(self.some) else np.arange(self.start, self.stop, dtype=np.int32)


@dataclass(frozen=True)
class PhotonsTraced:
    """All photon paths of a task have ended.

    Attributes:
        paths: how many.
        emitted: flux that they set out with, mean of RGB, summed [W x paths].
    """

    number: int
    paths: int
    emitted: float


@dataclass(frozen=True, eq=False)
class BucketRendered:
    """The pixels of a bucket.

    Attributes:
        layers: name of layer -> float32, shape [y1 - y0, x1 - x0, 3] or [y1 - y0, x1 - x0].
    """

    number: int
    x0: int
    y0: int
    layers: dict[str, NDArray[np.float32]]


@dataclass(frozen=True, eq=False)
class RecordsMade:
    """The irradiance records of a task.

    Attributes:
        rays: gather rays that were shot for them.
    """

    number: int
    round: int
    records: Records
    rays: int


Task = PhotonTask | RecordTask | BucketTask
TaskResult = PhotonsTraced | RecordsMade | BucketRendered
