"""The buckets of an image, as tasks: large ones first, small ones last, so that all who render end together."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from wdpm.cluster.master.film import spiral
from wdpm.cluster.task import BucketTask
from wdpm.cluster.world import View

Place = tuple[int, int, int, int]
"""x0, y0, x1, y1 of a bucket."""

LEAST = 32
"""Side of a bucket that is not divided further [pixels]: what the interpreter does for each is a fifth of the rest."""

SHARES = 1.5
"""Buckets are divided where each who renders would get fewer of them than this from what is left."""


def place_of(task: BucketTask) -> Place:
    """Where a bucket lies."""
    return task.x0, task.y0, task.x1, task.y1


def buckets(view: View, at_once: int, first_number: int, kept: Collection[Place] = ()) -> list[BucketTask]:
    """The buckets of a view, ring by ring from the centre of the image.

    Args:
        at_once: buckets that are rendered at a time; 0 or 1 for none that are divided.
        kept: places of buckets that are there: an image is divided into those again, as far as they belong to it.
    """
    whole = spiral(view.camera.width, view.camera.height, view.bucket)
    places: list[Place] = []
    left = view.camera.width * view.camera.height
    for bucket in whole:
        side = view.bucket
        while at_once > 1 and side % 2 == 0 and side // 2 >= LEAST and side * side * at_once * SHARES > left:
            side //= 2
        places += _pieces(place_of(bucket), view.bucket, side, kept)
        left -= (bucket.x1 - bucket.x0) * (bucket.y1 - bucket.y0)
    return [BucketTask(first_number + index, *place) for index, place in enumerate(places)]


def _pieces(place: Place, side: int, wanted: int, kept: Collection[Place]) -> Iterator[Place]:
    """What a bucket of a side is divided into, by halves: pieces of the side that is wanted, and kept ones.

    Args:
        place: of the bucket, which ends where the image does.
    """
    divided = side > wanted or any(_holds(place, each) for each in kept)
    if place in kept or not divided or side % 2:
        yield place
        return
    x0, y0, x1, y1 = place
    half = side // 2
    for y in (y0, y0 + half):
        for x in (x0, x0 + half):
            if x < x1 and y < y1:
                yield from _pieces((x, y, min(x + half, x1), min(y + half, y1)), half, wanted, kept)


def _holds(place: Place, other: Place) -> bool:
    """Whether another place lies within one."""
    return place[0] <= other[0] and place[1] <= other[1] and other[2] <= place[2] and other[3] <= place[3]
