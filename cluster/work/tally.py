"""What a worker counts, as values that can be taken away and added elsewhere.

Counters are arrays, dictionaries of numbers, dataclasses of numbers and arrays, and single numbers of an object. Adding
is all that is ever done to them, so what several processes counted can be put together in any order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays
from wdpm.kernels.limits import MAPS


@dataclass(frozen=True, eq=False)
class Number:
    """A number that is an attribute of an object."""

    owner: Any
    name: str


@dataclass
class PhotonCounters:
    """What was stored, for the report.

    Attributes:
        by_light: photons that each light has in each map, shape [MAPS, lights].
        flux_by_light: their flux, mean of RGB [W x paths], shape [MAPS, lights].
    """

    by_light: NDArray[np.int64]
    flux_by_light: NDArray[np.float64]

    def add(self, photons: Arrays, light: NDArray[np.int32]) -> NDArray[np.int64]:
        """Count stored photons of these lights. Returns how many each map has of them, shape [MAPS]."""
        shape = self.by_light.shape
        key = photons["map"].astype(np.int64) * shape[1] + light
        counted = np.bincount(key, minlength=shape[0] * shape[1]).reshape(shape)
        self.by_light += counted
        red, green, blue = photons["flux"].T
        flux = (red.astype(np.float64) + green + blue) / 3.0  # a fifth of the time of NumPy's mean of rows
        self.flux_by_light += np.bincount(key, flux, shape[0] * shape[1]).reshape(shape)
        of_maps: NDArray[np.int64] = counted.sum(axis=1)
        return of_maps


def no_photons(lights: int) -> PhotonCounters:
    """Counters of so many lights at 0."""
    return PhotonCounters(np.zeros((MAPS, lights), np.int64), np.zeros((MAPS, lights)))


Counter = Any
"""An array, a dictionary, a dataclass or a Number; changed in place."""


def read(counters: Sequence[Counter]) -> list[Any]:
    """The values of some counters, as plain data: numbers, lists, dictionaries."""
    return [_read(counter) for counter in counters]


def clear(counters: Sequence[Counter]) -> None:
    """Set all to zero."""
    for counter in counters:
        if isinstance(counter, np.ndarray):
            counter[...] = 0
        elif isinstance(counter, dict):
            counter.clear()
        elif isinstance(counter, Number):
            setattr(counter.owner, counter.name, type(getattr(counter.owner, counter.name))(0))
        else:
            clear(_parts(counter))


def add(counters: Sequence[Counter], values: Sequence[Any]) -> None:
    """Add what `read` gave of counters like these."""
    for counter, value in zip(counters, values, strict=True):
        if isinstance(counter, np.ndarray):
            counter += np.asarray(value, counter.dtype).reshape(counter.shape)
        elif isinstance(counter, dict):
            for name, amount in value.items():
                counter[name] = counter.get(name, 0) + amount
        elif isinstance(counter, Number):
            setattr(counter.owner, counter.name, getattr(counter.owner, counter.name) + value)
        else:
            add(_parts(counter), value)


def _read(counter: Counter) -> Any:
    if isinstance(counter, np.ndarray):
        return counter.tolist()
    if isinstance(counter, dict):
        return dict(counter)
    if isinstance(counter, Number):
        return getattr(counter.owner, counter.name)
    return read(_parts(counter))


def _parts(counter: Counter) -> list[Counter]:
    """The counters that the fields of a dataclass are."""
    parts: list[Counter] = []
    for field in fields(counter):
        value = getattr(counter, field.name)
        parts.append(value if isinstance(value, np.ndarray | dict) else Number(counter, field.name))
    return parts
