"""Views that the command line asks for: from elsewhere, and a part of the image."""

from __future__ import annotations

from argparse import ArgumentTypeError
from dataclasses import replace

import numpy as np
import pytest
from furnaces import rendered

from wdpm import values
from wdpm.scenes import SceneError, cornell_box
from wdpm.scenes.model.viewpoint import Viewpoint, cropped, seen_from


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0,1,5/0,0,0", Viewpoint((0, 1, 5), (0, 0, 0))),
        ("0,1,5/0,0,0/0,0,1", Viewpoint((0, 1, 5), (0, 0, 0), (0, 0, 1))),
        ("-1,1e2,.5/0,0,-2/40", Viewpoint((-1, 100, 0.5), (0, 0, -2), fov=40.0)),
        ("0,1,5/0,0,0/0,0,1/40.5", Viewpoint((0, 1, 5), (0, 0, 0), (0, 0, 1), 40.5)),
    ],
)
def test_a_camera_on_the_command_line(text: str, expected: Viewpoint) -> None:
    assert values.viewpoint(text) == expected
    assert values.viewpoint(values.viewpoint_text(expected)) == expected


@pytest.mark.parametrize(
    "text", ["", "0,1,5", "0,1/0,0,0", "0,1,5/0,0,0/180", "0,1,5/0,0,0/40/0,1,0", "a,b,c/0,0,0", "0,1,nan/0,0,0"]
)
def test_what_is_no_camera_is_told(text: str) -> None:
    with pytest.raises(ArgumentTypeError, match="is not a camera: expected FROM/AT"):
        values.viewpoint(text)


def test_the_scene_is_seen_from_there() -> None:
    scene = seen_from(cornell_box((8, 6)), Viewpoint((1, 2, 3), (1, 2, 10), fov=33.0))
    np.testing.assert_allclose(scene.camera.to_world[:3, 3], [1, 2, 3])
    np.testing.assert_allclose(scene.camera.to_world[:3, 2], [0, 0, 1])
    assert scene.camera.fov_x == 33.0
    assert scene.warnings[-1] == "--camera: it looks from 1 2 3 to 1 2 10, up 0 1 0, 33 degrees wide"


def test_views_that_cannot_be_are_errors() -> None:
    scene = cornell_box((8, 6))
    with pytest.raises(SceneError, match="--camera"):
        seen_from(scene, Viewpoint((1, 2, 3), (1, 2, 3)))
    parallel = replace(scene, camera=replace(scene.camera, orthographic=True))
    with pytest.raises(SceneError, match="no field of view"):
        seen_from(parallel, Viewpoint((1, 2, 3), (0, 0, 0), fov=30.0))
    for region in ((0, 0, 9, 6), (3, 2, 3, 4)):
        with pytest.raises(SceneError, match="beyond the image of 8x6"):
            cropped(scene, region)


def test_a_crop_is_cut_out_of_the_whole_image() -> None:
    scene = cornell_box((8, 6))
    chosen = {"spp": 2, "photons": 500}
    whole, part = rendered(scene, **chosen), rendered(cropped(scene, (2, 1, 7, 4)), **chosen)
    np.testing.assert_array_equal(part.layers["beauty"], whole.layers["beauty"][1:4, 2:7])
