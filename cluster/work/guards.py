"""Guards: what keeps an image finite and a render bounded where a scene asks for more, counted by cause.

A guard that acts costs light, or makes an estimate coarser, so none acts silently: each slave counts what its guards
did, by cause, and the report adds that up. In a strict render the first one that acts ends it, with an error that names
the sample or the photon path, so that a person can look at it (`--replay`).

What is part of the estimate is no guard: gathers that find fewer than k photons, Russian roulette, paths that end at
the depth that a person chose.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays
from wdpm.cluster.work.replica import Replica
from wdpm.scenes.errors import GuardError

NOT_FINITE: Final = "non-finite "
"""How the names of those causes begin that blacken a NaN or an infinity, which would spoil its pixel or its map."""

EMISSION: Final = NOT_FINITE + "emission"
DIRECT: Final = NOT_FINITE + "direct"
INDIRECT: Final = NOT_FINITE + "indirect"
CAUSTIC: Final = NOT_FINITE + "caustic"
VOLUME: Final = NOT_FINITE + "volume"
THROUGHPUT: Final = NOT_FINITE + "throughput"
PHOTON: Final = NOT_FINITE + "photon"
COINCIDENT: Final = "coincident gathers"
PATHS_CUT: Final = "camera paths cut"
BEAMS_CLAMPED: Final = "beams clamped"
PHOTONS_CUT: Final = "photon paths cut"
DROPPED: Final = "triangles dropped"

CAUSES: Final[Mapping[str, str]] = {
    EMISSION: "light that a surface, or the space around the scene, sends to the camera is not finite",
    DIRECT: "light straight from a light is not finite",
    INDIRECT: "light gathered from the photon map is not finite",
    CAUSTIC: "light gathered from the caustic map is not finite",
    VOLUME: "light that a medium scatters towards the camera is not finite",
    THROUGHPUT: "what a camera path carries is not finite",
    PHOTON: "the flux of a stored photon is not finite",
    COINCIDENT: "all photons of a gather lie in one place, so they are averaged over the largest radius",
    PATHS_CUT: "a camera path is still going at the limit of vertices",
    BEAMS_CLAMPED: "a photon in a medium is too bright to be added exactly, so light is lost",
    PHOTONS_CUT: "a photon path is still going at the limit of bounces",
    DROPPED: "a triangle cannot be rendered",
}
"""Every cause, and what has happened."""


@dataclass(eq=False)
class Guards:
    """Counts of what guards did in one cell, by cause; in a strict render they raise GuardError instead.

    Rows are those of the rays that a batch brings: `pixel` and `sample` say whose they are.
    """

    replica: Replica
    counts: dict[str, int] = field(default_factory=dict)

    @property
    def strict(self) -> bool:
        """Whether the first guard that acts ends the render."""
        return self.replica.world.strict

    def act(self, cause: str, rows: NDArray[np.intp], rays: Arrays, times: int | None = None) -> None:
        """Count that a guard acted on some rays of camera paths.

        Args:
            times: how often, where that is not once a row.

        Raises:
            GuardError: the render is strict.
        """
        if not len(rows):
            return
        self.counts[cause] = self.counts.get(cause, 0) + (len(rows) if times is None else times)
        if self.strict:
            first = min(rows, key=lambda row: (int(rays["pixel"][row]), int(rays["sample"][row])))
            bounce = int(rays["bounce"][first]) if "bounce" in rays else 0
            raise self.error(cause, int(rays["pixel"][first]), int(rays["sample"][first]), bounce)

    def blacken(self, values: NDArray[np.float32], cause: str, rays: Arrays, each: int = 1) -> NDArray[np.float32]:
        """The values, shape [rays * each, 3], with rows that hold a NaN or an infinity made black, and counted."""
        if np.isfinite(values).all():
            return values
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        blackened = values.copy()
        blackened[bad] = 0.0
        self.act(cause, bad // each, rays)
        return blackened

    def act_on_photons(self, cause: str, path: NDArray[np.int64], bounce: NDArray[Any], light: NDArray[Any]) -> None:
        """Count that a guard acted on some photons; shapes [N].

        Raises:
            GuardError: the render is strict.
        """
        if not len(path):
            return
        self.counts[cause] = self.counts.get(cause, 0) + len(path)
        if self.strict:
            first = int(path.argmin())
            name = self.replica.world.lights.names[int(light[first])]
            raise GuardError(
                f'strict: {CAUSES[cause]}: photon path {int(path[first])} of light "{name}", bounce '
                f"{int(bounce[first])}; leave --strict out to render without it, and to have all such photons counted"
            )

    def error(self, cause: str, pixel: int, sample: int, bounce: int) -> GuardError:
        """The error about a sample of a pixel, which are counted row by row."""
        view = self.replica.view
        if view is None:
            raise ValueError("a camera sample came before a view was set")
        y, x = divmod(pixel, view.camera.width)
        return GuardError(
            f"strict: {CAUSES[cause]}: pixel {x},{y}, sample {sample}, vertex {bounce}; "
            f"to see its path: wdpm render SCENE ... --replay {x},{y},{sample}"
        )


def added(counts: Iterable[Mapping[str, int]]) -> dict[str, int]:
    """Counts of several guards together, in the order of CAUSES; causes that did not occur are left out."""
    counts = list(counts)
    names = [*CAUSES, *sorted({name for each in counts for name in each} - CAUSES.keys())]
    total = {name: sum(each.get(name, 0) for each in counts) for name in names}
    return {name: count for name, count in total.items() if count}
