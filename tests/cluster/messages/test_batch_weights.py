"""Weights of a triangle's corners come from peers: places in the scene are made of them."""

from __future__ import annotations

import numpy as np
import pytest
from fake_worker import arrays, make_world

from wdpm.cluster.batch import SCHEMAS, Batch, Kind
from wdpm.cluster.messages.checks import check_batch
from wdpm.scenes.errors import ProtocolError

WITH_HITS = [kind for kind in Kind if "u" in SCHEMAS[kind]]


def weighed(kind: Kind, name: str, weight: float) -> Batch:
    """A batch in which one weight is this."""
    held = arrays(kind, 3)
    held[name][1] = weight
    return Batch.of_task(kind, 1, 0, 0, 1, held)


@pytest.mark.parametrize("kind", WITH_HITS)
@pytest.mark.parametrize("name", ["u", "v"])
def test_what_is_no_weight_is_refused(kind: Kind, name: str) -> None:
    for weight in (np.nan, np.inf, -np.inf, 1e30, 2.0, -1.5):
        with pytest.raises(ProtocolError, match=rf"{kind.value}\.{name} is .*; expected -1 to less than 2"):
            check_batch(weighed(kind, name, weight), make_world(1))


@pytest.mark.parametrize("weight", [0.0, 1.0, -1e-6, 1.000001])
def test_weights_may_be_rounded(weight: float) -> None:
    for kind in WITH_HITS:
        check_batch(weighed(kind, "u", weight), make_world(1))
