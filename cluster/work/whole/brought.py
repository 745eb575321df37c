"""What paths that one launch followed within a cell bring home, and what of them goes on elsewhere, as batches."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from wdpm.cluster.batch import SCHEMAS, Batch, Kind, by_destination, take
from wdpm.cluster.runs import Runs
from wdpm.cluster.work import parts
from wdpm.cluster.work.misses import rest_of
from wdpm.cluster.work.shadows import Shadows
from wdpm.cluster.work.whole.within_cell import FollowedPaths


def brought(
    cell: int,
    runs: Runs,
    followed: FollowedPaths,
    shadows: Shadows,
    light_samples: int,
) -> Iterator[Batch]:
    """What paths bring home, and what goes on elsewhere.

    Args:
        cell: where they were followed.
        runs: whose they are, with their credit.
        shadows: sends shadow rays on.
        light_samples: of the view.
    """
    follows = [*shadows.send_on(runs, followed.shots), *_going_on(runs, followed, light_samples)]
    left = rest_of(runs, follows)
    lists = {
        Kind.GATHERED: followed.gathered,
        Kind.PIXELS: followed.pixels,
        Kind.SAMPLES: followed.first,
        Kind.LIT: followed.parts,
    }
    there = [kind for kind, items in lists.items() if items and len(items["whose"])] or [Kind.LIT]
    for kind in there:
        items = lists[kind]
        of_kind = runs.among(items["whose"])
        # A part of a task's credit comes with each kind, and all that is left with the last.
        credit = left if kind is there[-1] else np.minimum(of_kind.rows, 1)
        left = left - credit
        arrays = {name: items[name] for name in SCHEMAS[kind] if name in items}
        if kind is Kind.SAMPLES:
            arrays["cell"] = np.full(len(arrays["slot"]), cell, np.int32)
        yield Batch(kind, cell, of_kind.with_credit(credit), arrays)
    yield from follows


def _going_on(runs: Runs, followed: FollowedPaths, light_samples: int) -> Iterator[Batch]:
    """Rays that other cells are to be asked about, and final hits that this launch did not light."""
    paths = followed.paths
    begun, final = paths["bounce"] > 0, paths["onward"] < 0
    for kind, destination, chosen in (
        (Kind.PATH, paths["onward"], begun & ~final),
        (Kind.VERTEX, paths["owner"], begun & final),
        (Kind.CAMERA, paths["onward"], ~begun & ~final),
        (Kind.SHADE, paths["owner"], ~begun & final),
    ):
        for cell, rows in by_destination(destination, chosen):
            mine = runs.among(paths["whose"].take(rows))
            # The credit of a camera ray is that of a path without a bounce.
            credit = parts.credit_of(mine, paths["bounce"].take(rows), light_samples)
            sent = take({name: paths[name] for name in SCHEMAS[kind]}, rows)
            yield Batch(kind, cell, mine.with_credit(credit), sent)
