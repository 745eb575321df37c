"""What paths that one launch followed within a cell bring home, and what of them goes on elsewhere, as batches."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

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
    slots: NDArray[np.int32] | None = None,
) -> Iterator[Batch]:
    """What paths bring home, and what goes on elsewhere.

    Args:
        cell: where they were followed.
        runs: whose they are, with their credit.
        shadows: sends shadow rays on.
        light_samples: of the view.
        slots: of camera rays, of which first vertices are told; None of paths that have left theirs.
    """
    follows = [*shadows.send_on(runs, followed.shots), *_going_on(runs, followed, light_samples)]
    lit = followed.parts
    of_light = runs.among(lit["whose"])
    arrived = {name: lit[name] for name in SCHEMAS[Kind.LIT]}
    if slots is None:
        yield Batch(Kind.LIT, cell, of_light.with_credit(rest_of(runs, follows)), arrived)
        yield from follows
        return
    gone = followed.paths["whose"][followed.paths["bounce"] == 0]
    left = runs.sums(np.bincount(gone, minlength=len(slots)))
    # A part of the credit of each camera ray that is still here comes with its light.
    follows.append(Batch(Kind.LIT, cell, of_light.with_credit(runs.rows - left), arrived))
    hits = np.flatnonzero(followed.first["depth"] >= 0)
    samples = take({"slot": slots, **followed.first}, hits)
    samples["cell"] = np.full(len(hits), cell, np.int32)
    yield Batch(Kind.SAMPLES, cell, runs.among(hits).with_credit(rest_of(runs, follows)), samples)
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
