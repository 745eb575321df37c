"""Fields: what is said of each ray, photon or result that travels, declared in one place.

Structs of Warp (columns.py) and the schemas of batches (cluster.batch) are made of the same tables of fields, so each
has its name, its type, its meaning and what bounds it once. No Warp here: who only moves batches need not load it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum


class Many(Enum):
    """Things of a scene that fields number from 0, of which only its World says how many there are."""

    CELLS = "cells"
    LIGHTS = "lights"
    MEDIA = "media"


@dataclass(frozen=True)
class Field:
    """One array of a batch, or one member of a struct.

    Attributes:
        dtype: of a number, as numpy calls it, little-endian.
        shape: of one item: () for a number, (3,) for a vector.
        meaning: what it says; where a number has a unit, in brackets.
        least: smallest value that a receiver takes; None for any.
        end: the first whole number beyond what a receiver takes: a number, or that of how many things; None for any.
    """

    dtype: str
    shape: tuple[int, ...]
    meaning: str
    least: int | None = None
    end: int | Many | None = None


Fields = Mapping[str, Field]
"""Fields by name, in the order in which they lie in structs and travel."""


def integer(meaning: str, least: int | None = None, end: int | Many | None = None) -> Field:
    """An int32."""
    return Field("<i4", (), meaning, least, end)


def long_integer(meaning: str, least: int | None = None) -> Field:
    """An int64."""
    return Field("<i8", (), meaning, least)


def number(meaning: str, least: int | None = None, end: int | None = None) -> Field:
    """A float32."""
    return Field("<f4", (), meaning, least, end)


def long_number(meaning: str) -> Field:
    """A float64."""
    return Field("<f8", (), meaning)


def vector(meaning: str) -> Field:
    """Three float32: a point, a direction or a colour."""
    return Field("<f4", (3,), meaning)


def long_vector(meaning: str) -> Field:
    """Three float64: a sum of colours."""
    return Field("<f8", (3,), meaning)


def chosen(fields: Fields, *names: str) -> dict[str, Field]:
    """Some fields of a table, in the order of `names`."""
    return {name: fields[name] for name in names}
