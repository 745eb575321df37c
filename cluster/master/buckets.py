"""The buckets of an image, as tasks: large ones first, small ones last, so that all who render end together."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from wdpm.cluster.master.film import spiral
from wdpm.cluster.task import BucketTask
from wdpm.cluster.world import View

Rectangle = tuple[int, int, int, int]
"""x0, y0, x1, y1 of a bucket."""

LEAST = 32
"""Side of a bucket that is not divided further [pixels]: what the interpreter does for each is a fifth of the rest."""

SHARES = 1.5
"""Buckets are divided where each who renders would get fewer of them than this from what is left."""


def rectangle_of(task: BucketTask) -> Rectangle:
    """Where a bucket lies."""
    return task.x0, task.y0, task.x1, task.y1


def buckets(view: View, at_once: int, first_number: int, kept: Collection[Rectangle] = ()) -> list[BucketTask]:
    """The buckets of a view, ring by ring from the centre of the image.

    Args:
        at_once: buckets that are rendered at a time; 0 or 1 for none that are divided.
        kept: rectangles of buckets that are there: an image is divided into those again, as far as they belong to it.
    """
    whole = spiral(view.camera.width, view.camera.height, view.bucket)
    rectangles: list[Rectangle] = []
    left = view.camera.width * view.camera.height
    for bucket in whole:
        side = view.bucket
        while at_once > 1 and side % 2 == 0 and side // 2 >= LEAST and side * side * at_once * SHARES > left:
            side //= 2
        rectangles += _pieces(rectangle_of(bucket), view.bucket, side, kept)
        left -= (bucket.x1 - bucket.x0) * (bucket.y1 - bucket.y0)
    return [BucketTask(first_number + index, *rectangle) for index, rectangle in enumerate(rectangles)]


def _pieces(rectangle: Rectangle, side: int, wanted: int, kept: Collection[Rectangle]) -> Iterator[Rectangle]:
    """What a bucket of a side is divided into, by halves: pieces of the side that is wanted, and kept ones.

    Args:
        rectangle: of the bucket, which ends where the image does.
    """
    divided = side > wanted or any(_holds(rectangle, each) for each in kept)
    if rectangle in kept or not divided or side % 2:
        yield rectangle
        return
    x0, y0, x1, y1 = rectangle
    half = side // 2
    for y in (y0, y0 + half):
        for x in (x0, x0 + half):
            if x < x1 and y < y1:
                yield from _pieces((x, y, min(x + half, x1), min(y + half, y1)), half, wanted, kept)


def _holds(outer: Rectangle, inner: Rectangle) -> bool:
    """Whether a rectangle lies within another."""
    return outer[0] <= inner[0] and outer[1] <= inner[1] and inner[2] <= outer[2] and inner[3] <= outer[3]
