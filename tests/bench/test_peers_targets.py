"""`wdpm bench peers`: errors of images, errors that Mitsuba has, and the law that tells what was not rendered."""

from __future__ import annotations

import numpy as np
import pytest

from wdpm.bench.peers import mitsuba_program
from wdpm.bench.peers.law import ErrorLaw, Point
from wdpm.bench.peers.mitsuba import Cost
from wdpm.bench.peers.target import Bounds, RelMse, rel_mse_of, targets_of
from wdpm.images.image import Image


def grey(value: float) -> np.ndarray:
    return np.full((6, 8, 3), value, np.float32)


def test_the_worst_pixels_are_left_out() -> None:
    pixels = grey(1.0)
    pixels[0, 0] = 50.0
    image, reference = Image({"beauty": pixels}), Image({"beauty": grey(1.0)})
    found = rel_mse_of(image, reference, Bounds(trim=1 / 48))
    assert found.trimmed == 0
    assert found.whole == pytest.approx(49**2 / 1.01 / 48)
    whole = rel_mse_of(image, reference, Bounds())
    assert whole.whole == whole.trimmed
    pixels[1, 1] = np.inf  # counts as right, as it does for `wdpm compare`
    assert rel_mse_of(image, reference, Bounds(trim=1 / 48)).trimmed == 0


def test_errors_of_samples_are_measured_or_told_by_the_law() -> None:
    errors = {8: RelMse(1.0, 0.5), 32: RelMse(0.25, 0.125)}
    points = [Point(spp, error, Cost(1.0, 1.0)) for spp, error in errors.items()]
    points.append(Point(32, RelMse(0.35, 0.125), Cost(1.0, 1.0)))
    whole, far, trimmed, far_trimmed = targets_of(Bounds((), samples=(128, 32), trim=0.01), points)
    assert (whole.error, whole.spp, whole.by_law) == (pytest.approx(0.3), 32, False)
    assert (far.spp, far.by_law) == (128, True)
    assert far.error == pytest.approx((8.0 * 8.0 * 11.2) ** (1 / 3) / 128)
    assert (trimmed.error, trimmed.trimmed) == (0.125, True)
    assert far_trimmed.error == pytest.approx(4 / 128)
    assert far_trimmed.name == "0.0312 trimmed (128 samples*)"
    assert [target.error for target in targets_of(Bounds((0.1, 0.2)), points)] == [0.2, 0.1]


def test_time_beyond_what_was_rendered_is_a_line_through_the_ends() -> None:
    law = ErrorLaw(tuple(Point(n, 1 / n, Cost(3.0 + n, 2.0 * (3.0 + n))) for n in (8, 32, 16)))
    answer = law.beyond(1 / 128)
    assert (answer.spp, answer.cost) == (pytest.approx(128), Cost(pytest.approx(131), pytest.approx(262)))
    assert answer.extrapolated
    assert not law.beyond(1 / 16).extrapolated
    alone = ErrorLaw((Point(8, 1 / 8, Cost(4.0, 8.0)),))
    assert alone.beyond(1 / 16).cost == Cost(pytest.approx(8), pytest.approx(16))


def test_an_image_of_many_samples_is_rendered_in_equal_parts() -> None:
    pixels = mitsuba_program.MOST_SAMPLES // 256
    assert [mitsuba_program.parts_of(spp, pixels) for spp in (1, 256, 1024, 1025, 263)] == [1, 1, 4, 5, 263]
    assert mitsuba_program.parts_of(2, 3 * mitsuba_program.MOST_SAMPLES) == 2


def test_a_law_of_one_over_samples() -> None:
    law = ErrorLaw(tuple(Point(n, 0.5 / n, Cost(n / 10, n / 5)) for n in (8, 32, 128)))
    assert law.constant == pytest.approx(0.5)
    assert law.slope == pytest.approx(-1)
    answer = law.to(0.01)
    assert answer.spp == pytest.approx(50)
    assert (answer.cost.wall_s, answer.cost.cpu_s) == pytest.approx((5, 10))
    assert not answer.extrapolated
    assert law.to(0.001).extrapolated
    assert law.to(0.1).extrapolated
    assert law.to(9.0).spp == 1  # there is no image with less
    assert law.to(0.01, Point(16, 0.5, Cost(16.0, 32.0))).cost == Cost(pytest.approx(50), pytest.approx(100))


def test_a_single_number_of_samples_has_no_slope() -> None:
    point = Point(8, 0.1, Cost(1, 1))
    assert ErrorLaw((point, point)).slope is None
    assert ErrorLaw((point,)).constant == pytest.approx(0.8)


def test_an_image_without_error_takes_one_sample() -> None:
    law = ErrorLaw((Point(8, 0.0, Cost(1, 1)), Point(32, 0.0, Cost(4, 4))))
    assert law.slope is None
    assert law.to(0.01).spp == 1
