"""Light that lit places would send to records: through the strata that ways to them lead through, by both cosines."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp
from numpy.typing import ArrayLike, NDArray

from wdpm.kernels.irradiance.records import stratum_direction
from wdpm.kernels.irradiance.unoccluded_light import REFLECTED, stratum_of, unoccluded_radiance, upload
from wdpm.kernels.maths.directions import around

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

ROWS, COLUMNS = 5, 9
UP, DOWN = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)


@wp.kernel
def there_and_back(
    normal: wp.array[wp.vec3], rows: wp.int32, columns: wp.int32, u: wp.array[wp.vec2], out: wp.array2d[wp.int32]
) -> None:
    i, stratum = wp.tid()
    row = stratum // columns
    direction = stratum_direction(normal[i], row, stratum - row * columns, rows, columns, u[i])
    cosine = wp.dot(direction, normal[i])
    x = wp.dot(direction, around(normal[i], wp.vec3(1.0, 0.0, 0.0)))
    y = wp.dot(direction, around(normal[i], wp.vec3(0.0, 1.0, 0.0)))
    out[i, stratum] = stratum_of(cosine * cosine, x, y, rows, columns)


def vectors(values: ArrayLike) -> Any:
    return wp.array(np.atleast_2d(np.asarray(values, np.float32)), dtype=wp.vec3, device="cpu")


def unoccluded(
    places: ArrayLike,
    normal: ArrayLike,
    power: float = 1.0,
    radius: float = 0.1,
    of: ArrayLike = UP,
    shading: Any = None,
) -> NDArray[np.float32]:
    """Radiance through the strata of a record at the origin."""
    position = np.atleast_2d(np.asarray(places, np.float32))
    facing = np.broadcast_to(np.asarray(normal, np.float32), position.shape)
    each = [np.full(len(position), value, np.float32) for value in (power, radius)]
    out = wp.zeros((1, ROWS * COLUMNS), dtype=wp.float32, device="cpu")
    site = [vectors((0.0, 0.0, 0.0)), vectors(of), vectors(of if shading is None else shading)]
    inputs = [upload(position, np.ascontiguousarray(facing), *each), *site, ROWS, COLUMNS, 0, out]
    wp.launch(unoccluded_radiance, 1, inputs=inputs, device="cpu")
    found: NDArray[np.float32] = out.numpy()[0]
    return found


def test_a_direction_lies_in_the_stratum_that_it_was_drawn_from() -> None:
    rng = np.random.default_rng(1)
    normal = rng.normal(size=(200, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    u = wp.array(rng.uniform(0.01, 0.99, (200, 2)).astype(np.float32), dtype=wp.vec2, device="cpu")
    out = wp.empty((200, ROWS * COLUMNS), dtype=wp.int32, device="cpu")
    wp.launch(there_and_back, (200, ROWS * COLUMNS), inputs=[vectors(normal), ROWS, COLUMNS, u, out], device="cpu")
    np.testing.assert_array_equal(out.numpy(), np.tile(np.arange(ROWS * COLUMNS), (200, 1)))


def test_it_is_the_radiance_that_brings_the_irradiance_of_the_place() -> None:
    """E = power * share / pi * cos cos' / d², and a stratum of radiance L brings pi L / M."""
    found = unoccluded((3.0, 0.0, 4.0), DOWN, power=10.0)
    irradiance = 10.0 * float(REFLECTED) / np.pi * 0.8 * 0.8 / 25.0
    assert np.count_nonzero(found) == 1
    assert found.sum() * np.pi / (ROWS * COLUMNS) == pytest.approx(irradiance, rel=1e-5)


def test_near_places_send_no_more_than_from_their_radius() -> None:
    assert unoccluded((0.0, 0.0, 0.01), DOWN).sum() == pytest.approx(unoccluded((0.0, 0.0, 0.1), DOWN).sum())
    assert unoccluded((0.0, 0.0, 0.2), DOWN).sum() == pytest.approx(
        unoccluded((0.0, 0.0, 0.1), DOWN).sum() / 4, rel=1e-5
    )


@pytest.mark.parametrize(
    ("place", "normal", "shading"),
    [
        ((0.0, 0.0, 1.0), UP, None),  # lit on its other side
        ((1.0, 0.0, -0.1), DOWN, None),  # below the surface
        ((1.0, 0.0, 0.1), (-1.0, 0.0, 0.0), (-0.8, 0.0, 0.6)),  # below the bent normal's horizon
        ((0.0, 0.0, 0.0), DOWN, None),  # the very place
    ],
)
def test_places_that_see_nothing_of_the_record_send_nothing(place: ArrayLike, normal: ArrayLike, shading: Any) -> None:
    assert not unoccluded(place, normal, shading=shading).any()


def test_several_places_add_up() -> None:
    places = np.random.default_rng(2).uniform((-1.0, -1.0, 0.5), (1.0, 1.0, 2.5), (50, 3))
    each = np.sum([unoccluded(place, DOWN) for place in places], axis=0)
    np.testing.assert_allclose(unoccluded(places, DOWN), each, rtol=1e-5)
