"""What each kind of leaf of a material's tree says of itself: its number, its parameters, what it calls for.

The material table, the facts and ways derived from it, the words of reports and the set of kernels all ask here. The
kind of a data class is its KIND (bsdfs.py); what kernels do for it is in the module of kernels.materials that reads it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

BLACK: Final = 0
"""Number of the kind that absorbs all light: a one-sided material seen from behind."""

SLOTS: Final = 13
"""Parameters of a row of the material table. What a parameter is worth is the row's value times its texture, if any."""


@dataclass(frozen=True, eq=False)
class Row:
    """A leaf as a row of the material table.

    Attributes:
        slots: of its parameters.
        value: float32, shape [SLOTS, 3].
        texture: number of each parameter's texture or -1, int32, shape [SLOTS].
    """

    slots: dict[str, int]
    value: NDArray[np.float32]
    texture: NDArray[np.int32]

    def number(self, name: str) -> float:
        """A parameter, or the factor of its texture."""
        return float(self.value[self.slots[name], 0])

    def is_zero(self, name: str) -> bool:
        """Whether a parameter is 0 everywhere."""
        return self.number(name) <= 0

    def may_shine(self, name: str) -> bool:
        """Whether a colour may be above zero somewhere."""
        return bool(self.value[self.slots[name]].max() > 0)

    def is_one(self, name: str) -> bool:
        """Whether a parameter is 1 everywhere."""
        return bool(self.texture[self.slots[name]] < 0 and self.number(name) >= 1)

    def differ(self, first: str, second: str) -> bool:
        """Whether two parameters may differ somewhere."""
        a, b = self.slots[first], self.slots[second]
        return bool(self.value[a, 0] != self.value[b, 0] or self.texture[a] != self.texture[b])


def never(_row: Row) -> bool:
    """For what no leaf of a kind does."""
    return False


def always(_row: Row) -> bool:
    """For what all leaves of a kind do."""
    return True


@dataclass(frozen=True, eq=False)
class LeafKind:
    """A kind of leaf.

    Attributes:
        number: in MaterialTable.kind.
        name: what people call it.
        slots: where in a row each parameter of the data class is written.
        feature: the field of kernels.features.Features with which its code is compiled; None for what always is.
        gathers: whether photons are stored on its front: it has a diffuse part that may be above black.
        lambertian: whether that part is alike in all directions.
        even: whether what it reflects can be told by irradiance and how much that grazes it (kernels.maths.schlick).
        glossy: whether it has a part that is traced on, not gathered.
        rough: parameters that are roughnesses of microfacets, without which only mirror directions are compiled.
        always_rough: whether it is a surface of microfacets whatever its parameters.
        through: whether its diffuse part has its light from behind: photons are stored on both sides of it, and what is
            seen of it are those of the other side.
        transmits: whether some light gets to the other side.
        straight: whether some light goes straight on there, unscattered.
        tells_tangents: whether its looks depend on the direction in which u runs.
    """

    number: int
    name: str
    slots: dict[str, int]
    feature: str | None = None
    gathers: Callable[[Row], bool] = never
    lambertian: bool = True
    even: Callable[[Row], bool] = always
    glossy: bool = True
    rough: tuple[str, ...] = ()
    always_rough: bool = False
    through: bool = False
    transmits: Callable[[Row], bool] = never
    straight: bool = False
    tells_tangents: Callable[[Row], bool] = never

    def row(self, value: NDArray[Any], texture: NDArray[Any]) -> Row:
        """A row of this kind."""
        return Row(self.slots, value, texture)

    def is_rough(self, row: Row) -> bool:
        """Whether a leaf calls for the code of microfacets besides that of its kind."""
        return any(row.number(name) > 0.0 for name in self.rough)

    def is_smooth(self, row: Row) -> bool:
        """Whether a leaf's light goes on in single directions, in which shadow rays find no lamp."""
        return self.glossy and not (self.always_rough or self.is_rough(row))


def in_order(*names: str) -> dict[str, int]:
    """Slots of parameters, one after another; a slot whose name is empty stays free."""
    return {name: slot for slot, name in enumerate(names) if name}
