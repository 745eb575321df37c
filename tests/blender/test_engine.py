"""The engine inside Blender: bad scenes, unsupported nodes, goals, Esc, view layers, slaves, installation."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from wdpm.blender.extension import write_extension

Check = Callable[[str], tuple[Any, list[str]]]


@pytest.fixture
def check(in_blender: Callable[..., str], tmp_path: Path) -> Check:
    """Runs a function of checks_in_blender.py; returns what it found and what wdpm said."""

    def run(name: str) -> tuple[Any, list[str]]:
        printed = in_blender("checks_in_blender.py", name, tmp_path, BLENDER_USER_RESOURCES=str(tmp_path))
        last = json.loads(printed.strip().splitlines()[-1])
        return last["found"], last["said"]

    return run


def test_bad_scenes_are_one_clear_line_each(check: Check) -> None:
    found, _ = check("bad_scenes")
    assert found == {
        "no camera": "the scene has no camera: add one (Add > Camera), or make one active (Ctrl-Numpad 0)",
        "panorama": 'camera "Eye": type PANO is not supported; expected a perspective or orthographic camera',
        "nothing": "the scene is empty: it has no triangles",
        "no light": "the scene has no light: nothing would be seen; add an area or a point emitter",
        "no region": "the render region is empty: draw a larger one (Ctrl-B), or clear it (Ctrl-Alt-B)",
    }


def test_a_render_that_fails_says_so_and_does_not_crash(check: Check) -> None:
    found, _ = check("failed")
    assert "Error: wdpm: the scene has no light" in found


def test_what_is_not_supported_is_named_with_what_stands_in_its_place(check: Check) -> None:
    found, _ = check("unsupported")
    assert sorted(found) == [
        'material "Fur": Hair BSDF is not supported: a diffuse grey surface stands for it',
        'material "Marble": Noise Texture is not supported: grey stands for it',
        'material "Skin": subsurface scattering of Principled BSDF is ignored',
        'material "Skin": the thin film of Principled BSDF is ignored',
        'object "Plane.003": visibility by kind of ray (camera) is not supported: all rays see it',
        'object "Volume": volume objects are not supported: it is left out',
        "render: a transparent film is not supported: the world is seen",
        'world "World": Sky Texture is not supported: a plain blue stands for it; bake it to an image to keep its sun',
    ]


def test_renders_to_an_error_and_to_a_time(check: Check) -> None:
    found, _ = check("goals")
    assert found["ERROR"] == pytest.approx(found["TIME"], rel=0.1)
    assert found["TIME"] > 0.1


def test_esc_ends_a_render(check: Check) -> None:
    found, said = check("cancelled")
    assert found == 4  # nothing asks on after the answer was yes
    assert said == []


@pytest.mark.sockets
def test_esc_ends_the_wait_for_slaves(check: Check) -> None:
    found, _ = check("cancelled_while_waiting")
    assert found["black"] == 0.0
    assert found["then"] > 0.1


def test_each_view_layer_is_rendered_with_its_own_objects_and_material(check: Check) -> None:
    found, _ = check("view_layers")
    assert found["Black.Combined"] == 0.0
    assert found["All.Combined"] != pytest.approx(found["Less.Combined"], rel=0.02)


@pytest.mark.sockets
def test_slaves_give_the_same_bits_and_stay_until_the_add_on_goes(check: Check) -> None:
    found, _ = check("on_slaves")
    assert found == {"same": [True, True], "codes": [0, 0], "again": True}


def test_blender_installs_the_extension(check: Check, tmp_path: Path) -> None:
    write_extension(tmp_path / "wdpm.zip")
    found, _ = check("installed")
    assert found["done"] == ["FINISHED"]
    assert (found["engine"], found["quality"], found["left"]) == ("WDPM", "ERROR", False)
    assert {"RENDER_PT_wdpm_quality", "EEVEE_MATERIAL_PT_surface", "EEVEE_WORLD_PT_surface"} <= set(found["panels"])
    assert not any("freestyle" in name or "lightprobe" in name for name in found["panels"])
