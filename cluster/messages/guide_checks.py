"""What a cluster's messages say of guides, checked: which light reaches where, and where caustics come from."""

from __future__ import annotations

import numpy as np

from wdpm.cluster.guide import CausticGuide, LightGuide
from wdpm.cluster.messages.demands import Shape
from wdpm.cluster.messages.demands import indices as _indices
from wdpm.cluster.messages.demands import require as _require

SHAPES_OF_GUIDES: dict[type, dict[str, Shape]] = {
    CausticGuide: {"target": ("lobes", 3), "rim": ("lobes",), "share": ("lobes",)},
}

SHARES_APART = 1e-3
"""How far the shares of a region's lobes may be from 1 together: they are of single precision."""


def check_light_guide(guide: LightGuide, where: str) -> None:
    """Tiles must also be those of the World's environment: the replica sees to that."""
    regions = len(guide)
    right = (
        (guide.chance.ndim, guide.starts.ndim, guide.distant.ndim) == (3, 2, 2)
        and regions & (regions - 1) == 0
        and len(guide.axis) == max(regions - 1, 0)
    )
    _require(right and guide.split.shape == guide.axis.shape, where, f"{regions} regions, {len(guide.axis)} planes")
    _indices(guide.axis, 0, 3, f"{where}.axis")
    tables = (guide.chance, guide.starts, guide.distant)
    _require(all(len(table) == regions for table in tables), where, "a table is not one row for each region")
    sound = all(bool(np.isfinite(table).all() and (table >= 0).all()) for table in tables)
    _require(sound and bool(np.isfinite(guide.split).all()), where, "a plane or a factor is no number, or negative")


def check_caustic_guide(guide: CausticGuide, where: str) -> None:
    """Regions whose lobes follow one another, and each of which has none or is sure to choose one."""
    regions, lobes = len(guide), len(guide.rim)
    right = regions & (regions - 1) == 0 and guide.axis.shape == guide.split.shape == (max(regions - 1, 0),)
    _require(right and guide.first.ndim == 1, where, f"{regions} regions, {len(guide.axis)} planes")
    _indices(guide.axis, 0, 3, f"{where}.axis")
    finite = bool(np.isfinite(guide.split).all() and np.isfinite(guide.target).all())
    _require(finite, where, "a plane or a target is no number")
    _require(bool(((guide.rim > 0) & (guide.rim <= 1)).all()), where, "a lobe is wider than a hemisphere, or no number")
    _require(bool(((guide.share >= 0) & (guide.share <= 1)).all()), where, "a share is not between 0 and 1")
    known = guide.part.shape == (regions,) and bool(((guide.part >= 0) & (guide.part < 1)).all())
    _require(known, where, "a part is not between 0 and 1, or not one for each region")
    if not regions:
        _require(lobes == 0, where, "lobes of no region")
        return
    counts = guide.first[1:].astype(np.int64) - guide.first[:-1]
    follow = guide.first[0] == 0 and guide.first[-1] == lobes and bool((counts >= 0).all())
    _require(follow, where, "lobes of regions do not follow one another")
    whole = np.bincount(np.repeat(np.arange(regions), counts), guide.share.astype(np.float64), regions)[counts > 0]
    _require(bool((np.abs(whole - 1.0) <= SHARES_APART).all()), where, "shares of a region's lobes are not 1 together")
