"""Who is shown an image while it is rendered: a display driver, as renderers have had them since RenderMan.

The master feeds one with buckets as they come, whoever rendered them; `wdpm.view` has the one that a browser looks at.
Slaves know nothing of it, and it changes no bit: it is handed what goes into the film, and may only read it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.allotment import NO_ALLOTMENT, Allotment

Layers = Mapping[str, NDArray[np.float32]]
"""Name of layer -> shape [height, width, 3], or [height, width] for one channel."""


@dataclass(frozen=True)
class Frame:
    """An image that begins: a whole render, or one pass of it.

    Attributes:
        width, height: of the image [pixels].
        channels: name of layer -> 1 or 3.
        first_sample, spp: the samples of each pixel that it takes; a pass goes on where the one before ended.
        holders: cell -> number of the slave that holds it.
        slaves: who they are, by number.
        allotment: the samples of each part of it, where these are not as many everywhere.
    """

    width: int
    height: int
    channels: Mapping[str, int]
    first_sample: int
    spp: int
    holders: tuple[int, ...]
    slaves: tuple[str, ...]
    allotment: Allotment = NO_ALLOTMENT


OF_NOBODY = -1
"""In place of the number of a slave."""


@dataclass(frozen=True, eq=False)
class Bucket:
    """Pixels that are done.

    Attributes:
        x0, y0: its upper left corner [pixels].
        layers: all of the frame.
        slave: number of the slave that put them together, OF_NOBODY if they were kept from an interrupted render; whose
            cells shaded them is the layer `cell`.
    """

    x0: int
    y0: int
    layers: Layers
    slave: int


@dataclass(frozen=True)
class SlaveSeen:
    """A slave of a cluster, as those see it who look at the image.

    Attributes:
        name: host and process.
        cells: how many it holds; whole: whether those are all of the scene.
        lost: it is no more.
        memory: that its process has in use now [bytes]; 0 before it has said so.
        cores: that it keeps busy.
        sent, received: by it, to and from all others [bytes/s].
    """

    name: str
    cells: int
    whole: bool
    lost: bool
    memory: int = 0
    cores: float = 0.0
    sent: float = 0.0
    received: float = 0.0


class PassMean(Protocol):
    """The mean of the passes so far, which costs something to work out: a display asks when it wants to know."""

    @property
    def spp(self) -> int:
        """Samples a pixel so far."""

    def layers(self) -> Layers:
        """The image, with `noise` and `bias` where there are passes enough to tell."""

    def relative_error(self) -> tuple[float, float, float] | None:
        """relMSE by the passes' own estimate, and both ends of its interval; None where they cannot tell yet."""


class Display(Protocol):
    """Shows an image while it is rendered.

    All calls come from the thread that renders, which waits for them: whoever has much to do does it elsewhere.
    """

    @property
    def enough(self) -> bool:
        """Whether the passes so far are good enough for the person: none is begun after the one in progress."""

    def begin(self, frame: Frame) -> None:
        """A frame begins; the one before has ended, if there was one."""

    def bucket(self, bucket: Bucket) -> None:
        """Pixels of the frame are done. Its arrays may be kept, and must not be written to."""

    def slaves(self, seen: Sequence[SlaveSeen]) -> None:
        """What slaves of a cluster hold and take has changed; all that ever were, by number. May come at any time."""

    def end(self, statistics: Sequence[Mapping[str, Any]]) -> None:
        """The frame is complete; what each slave held and did, by its number (CellWorker.statistics)."""

    def pass_done(self, mean: PassMean) -> None:
        """The frame was a pass, and is in the mean, which changes after this call."""


class Displays:
    """Several displays as one. There is enough when one of them says so."""

    def __init__(self, each: Sequence[Display]) -> None:
        self._each = tuple(each)

    @property
    def enough(self) -> bool:
        return any(display.enough for display in self._each)

    def begin(self, frame: Frame) -> None:
        for display in self._each:
            display.begin(frame)

    def bucket(self, bucket: Bucket) -> None:
        for display in self._each:
            display.bucket(bucket)

    def slaves(self, seen: Sequence[SlaveSeen]) -> None:
        for display in self._each:
            display.slaves(seen)

    def end(self, statistics: Sequence[Mapping[str, Any]]) -> None:
        for display in self._each:
            display.end(statistics)

    def pass_done(self, mean: PassMean) -> None:
        for display in self._each:
            display.pass_done(mean)
