"""What people get wrong in Python: each is an error of wdpm's own that says what was expected."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wdpm
from wdpm.cluster.display import Displays
from wdpm.images.image import load as load_image
from wdpm.rendering.in_process import InProcess
from wdpm.scenes.errors import SceneError, SettingsError, WdpmError


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"settings": {"spp": 3}}, r"settings is {'spp': 3}; expected wdpm.RenderSettings\(spp=16\), or single"),
        ({"settings": wdpm.RenderSettings(spp=1), "spp": 2}, "spp is given beside settings, which say all"),
        ({"size": "8x8"}, "size is no setting of a render but of its scene: give it to wdpm.load"),
        ({"photon": 3}, """there is no setting 'photon'; did you mean "photons"?"""),
        ({"spp": "3"}, "spp is '3'; expected a whole number"),
        ({"spp": 2.5}, "spp is 2.5; expected a whole number"),
        ({"photons": None}, "photons is None; expected a whole number"),
        ({"plan_samples": -1}, "plan_samples is -1; expected an integer of at least 1"),
        ({"radius": "wide"}, "radius is 'wide'; expected a number"),
        ({"strict": "no"}, "strict is 'no'; expected True or False"),
        ({"all_effects": None}, "all_effects is None; expected True or False"),
        ({"adaptive": 1}, "adaptive is 1; expected True or False"),
        ({"without": "lens"}, "without is 'lens'; expected names of effects, some of indirect, "),
        ({"until_error": 0.5, "size": "8x8"}, "give it to wdpm.load"),
    ],
)
def test_wrong_settings(given: dict[str, Any], expected: str) -> None:
    with pytest.raises(SettingsError, match=expected.replace("?", r"\?")):
        wdpm.render("cornell-box", **given)


def test_wrong_settings_of_a_replay_and_of_a_plan() -> None:
    wrong: Any = {"spp": 3}
    with pytest.raises(SettingsError, match=r"expected wdpm.RenderSettings"):
        wdpm.replay("cornell-box", 0, 0, 0, wrong)
    with pytest.raises(SettingsError, match=r"give it to wdpm.load"):
        wdpm.inspect("cornell-box", size=(8, 8))


def test_truth_of_numpy_is_plain() -> None:
    flag: Any = np.bool_(True)
    assert wdpm.RenderSettings(adaptive=flag).adaptive is True


@pytest.mark.parametrize("size", ["8x8", 8, (8,), (8, 8, 8), (8.5, 8)])
def test_wrong_sizes(size: Any) -> None:
    with pytest.raises(SceneError, match=r"expected width and height in pixels, like \(512, 384\)"):
        wdpm.load("cornell-box", size=size)


def test_files_may_be_named_by_strings(tmp_path: Path) -> None:
    scene = wdpm.load("cornell-box", size=tuple(np.array([8, 8])))
    chosen: dict[str, Any] = {"integrator": "photons", "indirect": "cache", "photons": 500, "spp": 1, "threads": 1}
    wdpm.render(scene, **chosen, save_cache=str(tmp_path / "cache"))
    wdpm.render(scene, **chosen, load_cache=str(tmp_path / "cache"), journal=str(tmp_path / "passes"))
    assert [path.name for path in tmp_path.iterdir()] == ["cache"]


def test_kept_passes_have_no_irradiance_records(tmp_path: Path) -> None:
    """They went nowhere, and nobody was told."""
    with pytest.raises(SettingsError, match="--save-cache: passes that are kept have no irradiance records"):
        wdpm.render("cornell-box", save_cache=tmp_path / "cache", journal=tmp_path / "passes")


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"threads": "2"}, "threads is '2'; expected a whole number"),
        ({"threads": 0}, "threads is 0; expected at least 1"),
        ({"threads": 1.5}, "threads is 1.5; expected a whole number"),
        ({"threads": 99_999}, r"threads is 99999; this machine has \d+ cores: give at most \d+"),
        ({"slaves": 2, "threads": 99_999}, r"threads is 99999; this machine has \d+ cores: give at most \d+"),
        ({"slaves": "2"}, "slaves is '2'; expected a whole number"),
        ({"slaves": 2, "threads": True}, "threads is True; expected a whole number"),
        ({"slaves": 2, "device": 7}, 'device is 7; expected "cpu" or a CUDA device, like "cuda:0"'),
        ({"device": 7}, 'device is 7; expected "cpu" or a CUDA device, like "cuda:0"'),
    ],
)
def test_wrong_machines(given: dict[str, Any], expected: str) -> None:
    with pytest.raises(SettingsError, match=expected):
        wdpm.render("cornell-box", **given)
    if "slaves" not in given:
        with pytest.raises(SettingsError, match=expected):
            wdpm.replay("cornell-box", 0, 0, 0, **given)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"slaves": 2, "copies": "some"}, """copies is 'some'; expected one of "none", "auto\""""),
        ({"slaves": 2, "memory": "4G"}, r"memory is '4G'; expected bytes, like 4 \* 2\*\*30"),
        ({"slaves": None}, "slaves is None; expected a whole number"),
    ],
)
def test_wrong_local_clusters(given: dict[str, Any], expected: str) -> None:
    with pytest.raises(SettingsError, match=expected):
        wdpm.Cluster.local(**given)


def test_wrong_clusters_elsewhere() -> None:
    any_port = "tcp://127.0.0.1:0"
    with pytest.raises(SettingsError, match="copies is 'some'"):
        wdpm.Cluster.listen(any_port, 1, copies="some")
    wrong: Any = "2"
    wrong_times: list[Any] = [0, -1.0, float("nan"), "5m", True]
    for wrong_time in wrong_times:
        with pytest.raises(SettingsError, match=r"join_timeout is .*; expected seconds above 0"):
            wdpm.Cluster.listen(any_port, 1, join_timeout=wrong_time)
    with pytest.raises(SettingsError, match="most is '2'; expected a whole number"):
        wdpm.Cluster.listen(any_port, 1, most=wrong)
    with pytest.raises(SettingsError, match=r"hosts is 'anna'; expected several, like \['anna'\]"):
        wdpm.Cluster.over_ssh("anna")
    for arguments in ({"memory": "4G"}, {"device": 7}, {"remote_wdpm": 7}):
        given: dict[str, Any] = arguments
        with pytest.raises(SettingsError, match=f"{next(iter(given))} is .*; expected"):
            wdpm.Cluster.over_ssh(["localhost"], **given)
    not_text: Any = 7117
    with pytest.raises(SettingsError, match="bind is 7117; expected an address"):
        wdpm.Cluster.listen(not_text, 1)


BOX = wdpm.load("cornell-box", size=(4, 4))
PIXELS = np.zeros((4, 4, 3), np.float32)
BLACK = wdpm.Image({"beauty": PIXELS})


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda: wdpm.render(lambda: None), "gave NoneType; expected wdpm.Scene"),
        (lambda: wdpm.render(BOX, load_cache=3), "3 is no name of a file"),
        (lambda: wdpm.render(BOX, journal="."), "is a folder; name a file in it"),
        (lambda: wdpm.load("a.obj", root="nowhere"), "no such file|is no folder"),
        (lambda: wdpm.compare(wdpm.Image({"beauty": PIXELS}, {}), "a.exr"), "str is no image"),
        (lambda: wdpm.Image({"beauty": [1, 2, 3]}, {}), "must be a float32 array of shape"),
        (lambda: wdpm.inspect(BOX, slaves=0), "slaves is 0; expected at least 1"),
        (lambda: wdpm.inspect(BOX, slaves="2"), "slaves is '2'; expected a whole number"),
        (lambda: wdpm.inspect(BOX, slaves=10**8), "100000000 slaves: at most 256 can be connected"),
        (lambda: wdpm.replay(BOX, 1.5, 0, 0), "x is 1.5; expected a whole number"),
        (lambda: wdpm.check(None), "NoneType is no scene"),
        (
            lambda: wdpm.render(BOX, display=1),
            r"display is 1; expected an object as .*\.Display says: it has no begin,",
        ),
        (lambda: wdpm.render(BOX, display=Displays), "display is .*: this is the class, not one of its objects"),
        (lambda: wdpm.render(BOX, progress=print), r"progress is <built.*\.Progress says: it has no advance, finish"),
        (lambda: wdpm.replay(BOX, 0, 0, 0, progress=1), "progress is 1; expected an object"),
        (lambda: wdpm.Cluster.local(1, observers=1), "observers is 1; expected functions"),
        (lambda: wdpm.Cluster.local(1, observers=[1]), r"observers is \[1\]; expected functions"),
        (lambda: wdpm.Cluster.over_ssh(None), "hosts is None; expected names of machines"),
        (lambda: wdpm.Cluster.over_ssh([1]), "'1' is no host"),
        (lambda: wdpm.Image(None), "an image's layers are None; expected a dictionary"),
        (lambda: wdpm.Image({"beauty": PIXELS}, 1), "an image's metadata are 1; expected a dictionary"),
        (lambda: BLACK.save(None), "None is no name of a file: expected one like 'image.exr'"),
        (lambda: BLACK.save(["a.exr"]), r"\['a.exr'\] is no name of a file"),
        (lambda: BLACK.save("a\0.exr"), r"'a\\x00.exr' is no name of a file: none has a zero byte"),
        (lambda: BLACK.save("a.exr", threads=0), "threads is 0; expected a whole number of at least 1"),
        (lambda: BLACK.save("a.exr", threads="2"), "threads is '2'; expected a whole number of at least 1"),
        (lambda: BLACK.to_srgb8(exposure=[]), r"exposure \[\]: expected 'auto' or stops"),
        (lambda: load_image(None), "None is no name of a file"),
        (lambda: wdpm.load("cornell-box", root=1), "root is 1; expected the name of a folder"),
        (lambda: wdpm.load("a.glb", time="1s"), "time is '1s'; expected seconds, like 1.5"),
        (lambda: wdpm.load("a.xml", defines=1), "defines is 1; expected a dictionary of values by name"),
        (lambda: wdpm.load("a.xml", defines={"spp": None}), "defines has 'spp': None; expected texts or numbers"),
    ],
)
def test_what_is_of_another_kind(call: Any, expected: str) -> None:
    with pytest.raises(WdpmError, match=expected):
        call()


def test_a_display_that_is_none_does_not_end_a_cluster() -> None:
    """It was asked in the middle of a render, which nobody can go on with."""
    backend = InProcess(threads=1)
    wrong: Any = 1
    with backend, pytest.raises(SettingsError, match="display is 1; expected an object"):
        backend.display = wrong
    assert backend.display is None


def test_values_of_a_scene_may_be_numbers(tmp_path: Path) -> None:
    """As Mitsuba's own interface takes them."""
    file = tmp_path / "scene.xml"
    file.write_text("""<scene version="3.0.0">
        <sensor type="perspective"><film type="hdrfilm"><integer name="width" value="$width"/></film>
            <float name="fov" value="$fov"/></sensor>
        <shape type="sphere"><boolean name="flip_normals" value="$flip"/></shape>
        <emitter type="constant"/></scene>""")
    camera = wdpm.load(file, defines={"width": 40, "fov": np.float64(20.5), "flip": True}).camera
    assert camera.width == 40
