"""What travels between workers: ray batches towards cells, results towards homes.

A batch is a set of equally long arrays with names. Its kind says which; `SCHEMAS` is the one list of them, and the
wire checks against it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import ProtocolError

Arrays = Mapping[str, NDArray[Any]]


class Kind(Enum):
    """What a batch holds. The first group goes to a cell, the second to a home."""

    CAMERA = "camera"
    """Camera rays, by pixel and sample number, with the best hit so far (routing `forward`)."""
    PROBE = "probe"
    """Camera rays, by pixel and sample number, to be intersected here and reported to the home (routing `merge`)."""
    SHADE = "shade"
    """Final camera hits, in the cell that contains the hit point."""
    PATH = "path"
    """Camera paths that have left their first surface, with the best hit so far."""
    VERTEX = "vertex"
    """Camera paths whose hit is final, in the cell that contains the hit point."""
    SCOUT = "scout"
    """Camera rays that look for places of irradiance records, with the best hit so far."""
    SITE = "site"
    """Scouts whose hit is final, in the cell that contains the hit point."""
    SHADOW = "shadow"
    """Shadow segments: what arrives in their slot if nothing blocks them."""
    WALK = "walk"
    """Shadow segments where light may pass straight through surfaces or media, with the best hit so far."""
    PANE = "pane"
    """Shadow segments whose hit is final, in the cell that contains the hit point: it may let light pass."""
    BEAM = "beam"
    """Stretches of camera rays in a medium, with the sums of what photons near them scatter towards the camera."""
    PHOTON = "photon"
    """Photons in flight, with the best hit so far."""
    LANDED = "landed"
    """Photons whose hit is final, in the cell that contains the hit point."""
    GHOSTS = "ghosts"
    """Copies of photons that lie in the destination cell's overlap band."""

    POINTS = "points"
    """Copies of surface points that lie in the destination cell's overlap band."""

    PROBED = "probed"
    """What a probe found: hits by slot."""
    SAMPLES = "samples"
    """What camera samples see, but for direct light: the fixed slots of a home."""
    LIT = "lit"
    """Parts of camera samples, by slot and place: direct light, and all that later vertices of a path add."""
    SITES = "sites"
    """Where scouts found that an irradiance record is wanted."""
    ENDED = "ended"
    """Nothing but credit: rays that ended."""


TO_HOME = frozenset({Kind.PROBED, Kind.SAMPLES, Kind.LIT, Kind.SITES, Kind.ENDED})

Schema = dict[str, tuple[str, tuple[int, ...]]]
"""Name of an array -> its dtype, little-endian, and the shape of one item."""

_RAY: Schema = {
    "slot": ("<i4", ()),  # where the home wants the result
    "pixel": ("<i4", ()),  # counted row by row
    "sample": ("<i4", ()),  # of the pixel
}

_HIT: Schema = {
    "t": ("<f4", ()),  # in units of the direction's length
    "prim": ("<i4", ()),  # global triangle number, -1 for none yet
    "u": ("<f4", ()),
    "v": ("<f4", ()),
    "owner": ("<i4", ()),  # the cell that contains the hit point
}

_PATH: Schema = {
    **_RAY,
    "bounce": ("<i4", ()),  # vertices before, those that light goes straight through included
    "edges": ("<i4", ()),  # of the path so far, straight passages not counted
    "diffuse": ("<i4", ()),  # scatterings from the first diffuse one on; negative if that was in a medium
    "medium": ("<i4", ()),  # that the ray is in, -1 for none
    "origin": ("<f4", (3,)),
    "direction": ("<f4", (3,)),
    "anchor": ("<f4", (3,)),  # the last vertex that scattered
    "throughput": ("<f4", (3,)),
    "pdf": ("<f4", ()),  # pdf_solid_angle of the direction at the anchor; 0 for a delta
    **_HIT,
}

_SEGMENT: Schema = {
    "slot": ("<i4", ()),
    "place": ("<i4", ()),  # which part of the sample it is: cluster.parts
    "origin": ("<f4", (3,)),
    "direction": ("<f4", (3,)),  # as long as the segment
    "radiance": ("<f4", (3,)),
}

_PHOTON: Schema = {
    "path": ("<i8", ()),
    "bounce": ("<i4", ()),
    "edges": ("<i4", ()),
    "state": ("<i4", ()),  # which parts of surfaces scattered it: kernels.photons.flight
    "medium": ("<i4", ()),
    "light": ("<i4", ()),
    "origin": ("<f4", (3,)),
    "direction": ("<f4", (3,)),
    "flux": ("<f4", (3,)),
    **_HIT,
}

_STORED: Schema = {
    "id": ("<i8", ()),
    "edges": ("<i4", ()),  # of its path from the light
    "front": ("<i4", ()),  # 1 where it landed on the front of the surface
    "map": ("<i4", ()),  # kernels.photons.deposits
    "position": ("<f4", (3,)),
    "flux": ("<f4", (3,)),
    "normal": ("<f4", (3,)),
    "direction": ("<f4", (3,)),
}

SCHEMAS: dict[Kind, Schema] = {
    Kind.CAMERA: {**_RAY, **_HIT},
    Kind.PROBE: _RAY,
    Kind.SHADE: {**_RAY, **_HIT},
    Kind.PATH: _PATH,
    Kind.SHADOW: _SEGMENT,
    Kind.WALK: {**_SEGMENT, "medium": ("<i4", ()), **_HIT},
    Kind.BEAM: {
        **_SEGMENT,  # the direction has length 1, radiance is the throughput before the stretch
        "length": ("<f4", ()),
        "medium": ("<i4", ()),
        "red": ("<i8", ()),
        "green": ("<i8", ()),
        "blue": ("<i8", ()),
    },
    Kind.PHOTON: _PHOTON,
    Kind.GHOSTS: _STORED,
    Kind.POINTS: {"map": ("<i4", ()), "position": ("<f4", (3,)), "normal": ("<f4", (3,))},
    Kind.PROBED: {"slot": ("<i4", ()), **_HIT},
    Kind.SAMPLES: {
        "slot": ("<i4", ()),
        "emission": ("<f4", (3,)),
        "indirect": ("<f4", (3,)),
        "depth": ("<f4", ()),
        "normal": ("<f4", (3,)),
        "albedo": ("<f4", (3,)),
        "cell": ("<i4", ()),
    },
    Kind.LIT: {"slot": ("<i4", ()), "place": ("<i4", ()), "radiance": ("<f4", (3,))},
    Kind.SITES: {
        "slot": ("<i4", ()),
        "position": ("<f4", (3,)),
        "normal": ("<f4", (3,)),  # unit, geometric, of the seen side
        "shading_normal": ("<f4", (3,)),
        "footprint": ("<f4", ()),  # width of a pixel there [scene units]
    },
    Kind.ENDED: {},
}
SCHEMAS[Kind.LANDED] = SCHEMAS[Kind.PHOTON]
SCHEMAS[Kind.SCOUT] = SCHEMAS[Kind.SITE] = SCHEMAS[Kind.CAMERA]
SCHEMAS[Kind.VERTEX] = SCHEMAS[Kind.PATH]
SCHEMAS[Kind.PANE] = SCHEMAS[Kind.WALK]


@dataclass(frozen=True, eq=False)
class Batch:
    """Arrays of one kind on their way to a cell or to a home.

    Attributes:
        task: number of the task that the contents belong to; -1 where there is none (ghosts).
        home: number of the worker that was handed the task; of ghosts, the worker that they come from.
        cell: the destination cell; for kinds that go to a home, the cell it comes from.
        credit: the share of the task's credit that travels with the batch (Mattern 1989).
        arrays: as SCHEMAS[kind] says.
    """

    kind: Kind
    task: int
    home: int
    cell: int
    credit: int
    arrays: Arrays

    def __len__(self) -> int:
        return next((len(array) for array in self.arrays.values()), 0)

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return sum(array.nbytes for array in self.arrays.values())

    def check(self) -> None:
        """Raise ProtocolError unless names, dtypes, shapes and lengths are those of the kind."""
        schema = SCHEMAS[self.kind]
        if self.arrays.keys() != schema.keys():
            raise ProtocolError(
                f"a {self.kind.value} batch has arrays {sorted(self.arrays)}; expected {sorted(schema)}"
            )
        count = len(self)
        for name, (dtype, shape) in schema.items():
            array = self.arrays[name]
            if array.dtype != np.dtype(dtype) or array.shape != (count, *shape):
                raise ProtocolError(
                    f"{self.kind.value}.{name} is {array.dtype} {array.shape}; expected {dtype} {(count, *shape)}"
                )


def take(arrays: Arrays, rows: NDArray[np.intp] | slice) -> dict[str, NDArray[Any]]:
    """Some rows of every array, ascending; the arrays themselves where that is all of them."""
    if not isinstance(rows, slice) and len(rows) == len(next(iter(arrays.values()))):
        return dict(arrays)
    return {name: array[rows] for name, array in arrays.items()}


def concatenate(parts: Iterable[Arrays], kind: Kind) -> dict[str, NDArray[Any]]:
    """Arrays of several batches of one kind, one after another."""
    parts = list(parts)
    if not parts:
        return {name: np.empty((0, *shape), dtype) for name, (dtype, shape) in SCHEMAS[kind].items()}
    return {name: np.concatenate([part[name] for part in parts]) for name in SCHEMAS[kind]}


def by_destination(destination: NDArray[np.int32], chosen: NDArray[np.bool_]) -> Iterator[tuple[int, NDArray[np.intp]]]:
    """The chosen rows, grouped by destination, in ascending order of both."""
    rows = np.flatnonzero(chosen)
    if not len(rows):
        return
    targets = destination[rows]
    if (targets == targets[0]).all():
        yield int(targets[0]), rows
        return
    for target in np.unique(targets):
        yield int(target), rows[targets == target]
