"""Arrays are told by their hints, whichever of NumPy's two kinds of alias a hint is."""

from __future__ import annotations

import types

import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.cluster.messages import packing


class Alias:
    """Stands in for NDArray as NumPy 2.5 has it with Python 3.12: an alias that is no array's type."""


def test_a_hint_of_this_numpy_is_an_arrays() -> None:
    assert packing._is_array(NDArray[np.float32])
    assert packing._dtype_of(NDArray[np.float32]) == np.dtype("<f4")
    assert not packing._is_array(tuple[int, ...])


def test_a_hint_that_stays_an_alias_is_an_arrays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packing, "NDArray", Alias)
    hint = types.GenericAlias(Alias, (np.int64,))
    assert packing._is_array(hint)
    assert packing._dtype_of(hint) == np.dtype("<i8")
