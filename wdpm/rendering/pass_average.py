"""The mean of passes: the image, how far it is from the truth, and the report of all passes together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.allotment import NO_ALLOTMENT, Allotment, spread
from wdpm.cluster.session import SessionResult
from wdpm.cluster.task import PhotonsTraced
from wdpm.images.channels import PARTITION_LAYER
from wdpm.images.image import Image
from wdpm.rendering.adaptive import AdaptiveSamples, weight_of
from wdpm.rendering.error_layers import BY_PHOTONS, ErrorEstimate, Values, same_shape, weight_like
from wdpm.rendering.pass_plan import PassPlan, PassResult, photon_plan, shrink
from wdpm.rendering.prepare import Prepared
from wdpm.rendering.results import image_of
from wdpm.report.report import ErrorReport, PassReport

LARGEST = frozenset({"peak_memory_bytes"})
"""Statistics of slaves of which the largest of all passes counts."""

LATEST = frozenset({"slave", "cells", "triangles"})
"""Statistics of slaves that are of the scene, not of what was done with it."""


class PassAverage:
    """The running mean of passes, weighted by their samples.

    Memory is that of some images in double precision, however many passes there are. Passes are added in the order of
    their numbers, in double, so the mean is the same bits whoever rendered them, and whether or not the render was
    interrupted between.

    Args:
        prepared: the scene, as a PassRenderer has it.
    """

    def __init__(self, prepared: Prepared) -> None:
        self._prepared = prepared
        self._reports: list[PassReport] = []
        self._plans: list[PassPlan] = []
        self._sums: dict[str, NDArray[Any]] = {}
        self._weight: Values = np.zeros(())  # samples of a pixel, as error_layers.Weight
        self._depth_weight: Values = np.zeros(0)
        self._error: ErrorEstimate | None = None
        self._statistics: list[dict[str, Any]] = []
        self._traced = PhotonsTraced(0, 0, 0.0)
        self._counted: dict[str, Any] = {}
        self._seconds: dict[str, float] = {}
        self._dropped: dict[str, int] = {}
        self._lost: tuple[str, ...] = ()  # since this process began ...
        self._unheard: tuple[str, ...] = ()  # ... as these
        self._went_on = False  # ... or before
        self._adaptive = AdaptiveSamples(prepared) if prepared.settings.adaptive else None

    @property
    def plans(self) -> tuple[PassPlan, ...]:
        """The passes that were added."""
        return tuple(self._plans)

    @property
    def spp(self) -> int:
        """Samples a pixel so far, on average."""
        return sum(plan.spp for plan in self._plans)

    @property
    def nbytes(self) -> int:
        """Memory of all arrays."""
        return sum(array.nbytes for array in self.arrays().values())

    def add(self, result: PassResult) -> None:
        """Take in a pass, the next by number."""
        plan, layers = result.plan, result.layers
        if self._plans and plan.number <= self._plans[-1].number:
            raise ValueError(f"pass {plan.number} came after pass {self._plans[-1].number}")
        if not self._plans:
            self._make_room(layers)
        self._plans.append(plan)
        weight = weight_of(plan, result.allotment, *self._size)
        self._weight = np.asarray(self._weight + weight)
        for name, layer in layers.items():
            if name == "depth":
                # A pass whose samples of a pixel all miss knows no depth there.
                known = _of_layer(weight, layer) * (layer > 0)
                self._depth_weight += known
                self._sums[name] += known * layer.astype(np.float64)
            elif name != PARTITION_LAYER:
                self._sums[name] += _of_layer(weight, layer) * layer.astype(np.float64)
            elif plan is self._plans[0]:
                self._sums[name][:] = layer
        self._error_of(layers).add(layers, weight, shrink(plan.number))
        if self._adaptive is not None:
            self._adaptive.add(plan, result.allotment, layers)
        self._account(result)

    def allotment(self, plan: PassPlan) -> Allotment:
        """The samples of each part of the image in the next pass: by what the passes so far tell, if that is wanted."""
        if self._adaptive is None or self._error is None:
            return NO_ALLOTMENT
        return self._adaptive.next(plan, self._error)

    def error(self) -> ErrorReport | None:
        """What the passes so far tell about the error of their mean; None before there are two."""
        return None if self._error is None else self._error.report()

    def relative_error(self) -> tuple[float, float, float] | None:
        """relMSE of the mean: the estimate and both ends of its interval; None before there are passes enough.

        Before a bias can be told it is that of noise alone.
        """
        error = self.error()
        if error is None:
            return None
        parts = error.rel_mse
        figure = parts.total or parts.noise
        return figure.value, figure.low, figure.high

    def layers(self) -> dict[str, NDArray[np.float32]]:
        """Of the mean, with `noise` and `bias` where there are passes enough to tell."""
        mean: dict[str, NDArray[np.float32]] = {}
        for name, total in self._sums.items():
            if name == PARTITION_LAYER:
                mean[name] = total.astype(np.float32)
            else:
                weight = self._depth_weight if name == "depth" else _of_layer(self._weight, total)
                mean[name] = (total / np.maximum(weight, 1.0)).astype(np.float32)
        if self._adaptive is not None and self._plans:
            mean["samples"] = spread(self._adaptive.samples, *self._size).astype(np.float32)
        return mean | ({} if self._error is None else self._error.layers())

    def image(self) -> Image:
        """The mean, the error layers, and the report of all passes together."""
        traced, seconds = (self._traced,), dict(self._seconds)
        together = SessionResult(
            self.layers(),
            self._statistics,
            traced,
            self._counted,
            seconds,
            self._dropped,
            lost=self._lost,
            unheard=self._unheard,
            went_on=self._went_on,
        )
        return image_of(self._prepared, together, tuple(self._reports), self.error())

    @property
    def _size(self) -> tuple[int, int]:
        """Width and height [pixels]."""
        camera = self._prepared.session.view.camera
        return camera.width, camera.height

    def _make_room(self, layers: Mapping[str, NDArray[np.float32]]) -> None:
        """Room for sums of layers like these."""
        for name, layer in layers.items():
            self._sums[name] = np.zeros(layer.shape, np.float32 if name == PARTITION_LAYER else np.float64)
        self._depth_weight = np.zeros(layers["depth"].shape) if "depth" in layers else np.zeros(0)
        self._error = self._error_of(layers)

    def _error_of(self, layers: Mapping[str, NDArray[np.float32]]) -> ErrorEstimate:
        if self._error is None:
            world = self._prepared.session.world
            by_photons = any(plan.paths and plan.read for plan in world.maps)
            self._error = ErrorEstimate(
                layers["beauty"].shape, by_photons and any(name in layers for name in BY_PHOTONS)
            )
        return self._error

    def _account(self, result: PassResult) -> None:
        """Add up what slaves and photons did."""
        plan, outcome = result.plan, result.result
        world = self._prepared.session.world
        radius = photon_plan(world, plan.number).global_map.radius * world.unit
        self._reports.append(PassReport(plan.number, plan.spp, radius, dict(result.seconds)))
        self._statistics = [
            merged(one, other) for one, other in _side_by_side(self._statistics, list(outcome.statistics))
        ]
        self._traced = PhotonsTraced(0, self._traced.paths + outcome.paths, self._traced.emitted + outcome.emitted)
        self._counted = merged(self._counted, outcome.counted)
        for phase, seconds in result.seconds.items():
            self._seconds[phase] = self._seconds.get(phase, 0.0) + seconds
        self._dropped = merged(self._dropped, outcome.dropped)
        self._lost += outcome.lost
        self._unheard += outcome.unheard
        self._went_on |= outcome.went_on

    # What a journal keeps (pass_journal).

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The state that is arrays, by name."""
        error = {} if self._error is None else self._error.arrays()
        sums = {f"sum.{name}": total for name, total in self._sums.items()}
        adaptive = {} if self._adaptive is None else self._adaptive.arrays()
        weights = {"weight": self._weight, "depth weight": self._depth_weight}
        return {
            **sums,
            **weights,
            **{f"error.{name}": a for name, a in error.items()},
            **{f"adaptive.{name}": a for name, a in adaptive.items()},
        }

    def account(self) -> dict[str, Any]:
        """The state that is no array, as JSON has it."""
        return {
            "plans": [asdict(plan) for plan in self._plans],
            "reports": [asdict(report) for report in self._reports],
            "statistics": self._statistics,
            "traced": asdict(self._traced),
            "counted": self._counted,
            "seconds": self._seconds,
            "dropped": self._dropped,
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]], account: Mapping[str, Any], like: Mapping[str, Any]) -> None:
        """Go on from what `arrays` and `account` gave.

        Args:
            like: name of layer -> shape, of this render.

        Raises:
            KeyError, TypeError, ValueError: that is of another render.
        """
        self._make_room({name: np.zeros(shape, np.float32) for name, shape in like.items()})
        for name, total in self._sums.items():
            self._sums[name] = same_shape(arrays[f"sum.{name}"], total)
        self._depth_weight = same_shape(arrays["depth weight"], self._depth_weight)
        self._weight = weight_like(arrays["weight"], np.empty((*self._size[::-1], 3)))
        for prefix, part in (("error.", self._error), ("adaptive.", self._adaptive)):
            if part is not None:
                part.restore({n.removeprefix(prefix): a for n, a in arrays.items() if n.startswith(prefix)})
        self._plans = [PassPlan(**plan) for plan in account["plans"]]
        self._reports = [PassReport(**report) for report in account["reports"]]
        self._statistics = list(account["statistics"])
        self._traced = PhotonsTraced(**account["traced"])
        self._counted = dict(account["counted"])
        self._seconds, self._dropped = dict(account["seconds"]), dict(account["dropped"])


def _of_layer(weight: Values, layer: NDArray[Any]) -> Values:
    """A weight of pixels as layers are shaped: with a third axis, or without."""
    return weight if weight.ndim == 0 or layer.ndim == 3 else weight[..., 0]


def merged(one: Any, other: Any) -> Any:
    """Statistics of two passes as one: counts are added, lists item by item."""
    if isinstance(one, dict):
        return {name: _merged_entry(name, one, other) for name in [*one, *(set(other) - set(one))]}
    if isinstance(one, list):
        return [merged(mine, yours) for mine, yours in zip(one, other, strict=True)]
    return one + other


def _merged_entry(name: str, one: dict[str, Any], other: dict[str, Any]) -> Any:
    if name not in one or name not in other:
        return one.get(name, other.get(name))
    if name in LATEST:
        return other[name]
    return max(one[name], other[name]) if name in LARGEST else merged(one[name], other[name])


def _side_by_side(
    one: Sequence[dict[str, Any]], other: Sequence[dict[str, Any]]
) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """By the numbers of slaves; where a render went on with more or fewer, those that are missing did nothing."""
    before, after = ({each["slave"]: each for each in statistics} for statistics in (one, other))
    return [(before.get(number, {}), after.get(number, {})) for number in sorted(before | after)]
