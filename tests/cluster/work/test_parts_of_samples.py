"""Parts of samples: what is worked out for many at once is what it is for each by itself."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wdpm.cluster.runs import Runs
from wdpm.cluster.work import parts

SHADOW_RAYS = st.integers(1, 4)


@given(st.data(), SHADOW_RAYS)
def test_layers_of_many_places_are_those_of_each(data: st.DataObject, light_samples: int) -> None:
    part = data.draw(st.sampled_from([parts.EMISSION, parts.INDIRECT, parts.CAUSTIC, parts.BEAM]))
    vertices = data.draw(st.lists(st.tuples(st.integers(0, 9), st.integers(-2, 2)), min_size=1, max_size=20))
    bounce, diffuse = (np.array(numbers, np.int32) for numbers in zip(*vertices, strict=True))
    place = parts.place_of(bounce, diffuse, part, light_samples)
    many = np.resize(place, int(place.max()) + 100)  # more than there are different places
    each = np.concatenate([parts.layer_of(place[i : i + 1], light_samples) for i in range(len(place))])
    np.testing.assert_array_equal(parts.layer_of(many, light_samples), np.resize(each, len(many)))
    assert parts.layer_of(many[:0], light_samples).shape == (0,)


@given(st.lists(st.lists(st.integers(0, parts.LAST_BOUNCE), max_size=6), min_size=1, max_size=5), SHADOW_RAYS)
def test_the_credit_of_a_run_is_enough_for_all_vertices_of_its_rays(
    bounces: list[list[int]], light_samples: int
) -> None:
    runs = Runs(np.array([[0, task, len(each), 7] for task, each in enumerate(bounces)], np.int64))
    bounce = np.array([number for each in bounces for number in each], np.int32)
    a_vertex = parts.credit_of_vertex(light_samples)
    expected = [sum((parts.LAST_BOUNCE + 1 - number) * a_vertex for number in each) for each in bounces]
    assert parts.credit_of(runs, bounce, light_samples).tolist() == expected
    assert parts.credit_of_camera_ray(light_samples) == (parts.LAST_BOUNCE + 1) * a_vertex
