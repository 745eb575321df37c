"""What the page shows is the mean of what has come."""

from __future__ import annotations

import numpy as np
from watching import bucket, frame

from wdpm.view.picture import NO_CELL, Picture, Rectangle
from wdpm.view.tiles import tiles_of


def test_buckets_of_the_first_frame_are_shown_as_they_are() -> None:
    picture = Picture()
    assert picture.size == (0, 0)
    assert picture.begin(frame(20, 10))
    assert picture.size == (20, 10)
    assert (picture.layers["cell"] == NO_CELL).all()
    one = bucket(16, 0, 4, 10, 0.1)
    assert picture.put(one) == Rectangle(16, 0, 20, 10)
    np.testing.assert_array_equal(picture.layers["beauty"][:, 16:], one.layers["beauty"])
    assert not picture.layers["beauty"][:, :16].any()


def test_passes_are_averaged_by_their_samples() -> None:
    picture = Picture()
    for first, spp, value in ((0, 2, 1.0), (2, 2, 3.0), (4, 4, 6.0)):
        assert picture.begin(frame(16, 4, first, spp)) == (first == 0)
        picture.put(bucket(0, 0, 8, 4, value))
    blue = picture.layers["beauty"][..., 2]
    np.testing.assert_allclose(blue[:, :8], (2 * 1 + 2 * 3 + 4 * 6) / 8)
    assert picture.spp == 4  # of the frames that are complete


def test_another_image_begins_anew() -> None:
    picture = Picture()
    picture.begin(frame(16, 4))
    picture.put(bucket(0, 0, 16, 4, 1.0))
    number = picture.now[0]
    for other in (frame(16, 4), frame(8, 4, 1), frame(8, 4, 7)):
        assert picture.begin(other)
        assert picture.now[0] > number
        assert not picture.layers["beauty"].any()


def test_tiles_cover_an_image_once() -> None:
    covered = np.zeros((300, 700), int)
    for tile in tiles_of(700, 300):
        covered[tile.y0 : tile.y1, tile.x0 : tile.x1] += 1
    assert (covered == 1).all()
