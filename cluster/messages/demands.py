"""What every check of a message is made of."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from wdpm.scenes.errors import ProtocolError

Shape = tuple[int | str, ...]
"""Of an array; a name stands for any length, the same wherever it occurs in one object."""


def require(condition: bool, where: str, what: str) -> None:
    """Raise ProtocolError unless a condition holds."""
    if not condition:
        raise ProtocolError(f"{where}: {what}")


def indices(array: NDArray[Any], least: int, end: int, where: str) -> None:
    """Raise ProtocolError unless all lie from `least` to below `end`.

    Whole numbers, or weights of a triangle's corners; NaN is outside, too.
    """
    # Of the few numbers that most batches have, NumPy finds the place of the least in a third of the time of `min`.
    if len(array) and not (array.item(array.argmin()) >= least and array.item(array.argmax()) < end):
        raise ProtocolError(f"{where} is {array.min()} to {array.max()}; expected {least} to less than {end}")
