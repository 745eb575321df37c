"""Top trees of a test's own: the partition that an image must not depend on."""

from __future__ import annotations

import numpy as np
import pytest

from wdpm.cluster.plan import render_plan
from wdpm.cluster.world import TopTree


def give_tree(monkeypatch: pytest.MonkeyPatch, axis: list[int], split: list[float]) -> None:
    """Have the next renders use this top tree, in the renderer's coordinates."""
    tree = TopTree(np.array(axis, np.int32), np.array(split, np.float32))
    monkeypatch.setattr(render_plan, "build_top_tree", lambda *_: tree)
