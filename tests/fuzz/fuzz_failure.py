"""What a fuzzer reports."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy.typing as npt

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Failure:
    """What went wrong, and the arrays that show it."""

    message: str
    data: dict[str, Array] = field(default_factory=dict)
