"""Irradiance records in a file: for other views of the scene, on any cluster, and never anything but records."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wdpm
from wdpm.api import render
from wdpm.cluster.records import NO_RECORDS
from wdpm.cluster.render_settings import Indirect, Integrator
from wdpm.images.image import Image, load
from wdpm.rendering.cache_file import CacheNotWrittenError, read_records, write_records
from wdpm.scenes.errors import ImageError, SettingsError
from wdpm.scenes.model.scene import Scene

FEW = {"photons": 4000, "spp": 2, "indirect": Indirect.CACHE}


@pytest.fixture(scope="module")
def box() -> Scene:
    scene = wdpm.load("cornell-box")
    return replace(scene, camera=replace(scene.camera, width=24, height=24))


@pytest.fixture(scope="module")
def saved(box: Scene, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Image]:
    path = tmp_path_factory.mktemp("cache") / "box.records"
    return path, render(box, save_cache=path, **FEW)


def digest(image: Image) -> bytes:
    return b"".join(layer.tobytes() for name, layer in sorted(image.layers.items()) if name != "cell")


def test_the_same_view_is_the_same_image(box: Scene, saved: tuple[Path, Image]) -> None:
    path, image = saved
    assert digest(render(box, load_cache=path, **FEW)) == digest(image)


def test_another_view_is_the_same_on_any_cluster(box: Scene, saved: tuple[Path, Image]) -> None:
    path, _ = saved
    seen = replace(box, camera=replace(box.camera, fov_x=box.camera.fov_x * 0.8))
    alone = render(seen, load_cache=path, **FEW)
    assert alone.metadata["report"]["phases"].get("records", 0) >= 0
    assert digest(render(seen, load_cache=path, slaves=2, threads=2, **FEW)) == digest(alone)


@pytest.mark.parametrize(
    "other",
    [
        *({"photons": 5000}, {"seed": 1}, {"k": 20}, {"max_depth": 4}),
        *({"caustic_photons": 5000}, {"caustic_k": 20}, {"caustic_radius": 0.01}, {"without": ("caustics",)}),
    ],
)
def test_records_of_other_photons_are_refused(box: Scene, saved: tuple[Path, Image], other: dict[str, Any]) -> None:
    with pytest.raises(ImageError, match=r"of another scene, or of other photons; .* --indirect cache for both"):
        render(box, load_cache=saved[0], **{**FEW, **other})


def test_a_render_without_a_cache_is_refused(box: Scene, tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"--save-cache.*--indirect cache"):
        render(box, save_cache=tmp_path / "x", **{**FEW, "indirect": Indirect.MAP})
    with pytest.raises(SettingsError, match="records of its own"):
        render(box, save_cache=tmp_path / "x", passes=2, **FEW)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        ({"integrator": Integrator.PATH}, "path tracing has no irradiance cache; leave --save-cache out"),
        ({"photons": 0}, "--photons 0 leaves nothing"),
        ({"without": ("indirect",)}, "--without indirect leaves nothing"),
    ],
)
def test_a_render_that_can_have_no_cache_says_why(
    box: Scene, tmp_path: Path, chosen: dict[str, Any], message: str
) -> None:
    with pytest.raises(SettingsError, match=message):
        render(box, save_cache=tmp_path / "x", **{**FEW, **chosen})


@pytest.mark.parametrize("place", ["nowhere/records", "."])
def test_a_place_that_cannot_be_written_is_found_before_anything_is_loaded(tmp_path: Path, place: str) -> None:
    def load() -> Scene:
        raise AssertionError("too late")

    with pytest.raises(ImageError, match=r"no folder|is a folder"):
        render(load, save_cache=tmp_path / place, **FEW)


def test_records_that_cannot_be_written_do_not_cost_the_image(
    box: Scene, saved: tuple[Path, Image], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("wdpm.rendering.array_file.write_whole", full)
    with pytest.raises(CacheNotWrittenError, match="cannot be written: No space left") as caught:
        render(box, save_cache=tmp_path / "x", **FEW)
    assert digest(caught.value.image) == digest(saved[1])


def test_a_changed_header_of_an_array_is_an_error(saved: tuple[Path, Image], tmp_path: Path) -> None:
    """It reaches Python's own parser, which raises errors of its own kinds."""
    path, whole = tmp_path / "broken", saved[0].read_bytes()
    assert whole.count(b"{'descr'") > 1
    path.write_bytes(whole.replace(b"{'descr'", b"{(descr'", 1))
    with pytest.raises(ImageError, match="has changed"):
        read_records(path, "scene")


def test_an_image_is_no_file_of_records(saved: tuple[Path, Image], tmp_path: Path) -> None:
    saved[1].save(tmp_path / "image.exr")
    with pytest.raises(ImageError, match="no file of irradiance records: it is no whole archive of arrays; write one"):
        read_records(tmp_path / "image.exr", "scene")


def test_objects_are_not_unpickled_nor_is_it_advised(tmp_path: Path) -> None:
    with (tmp_path / "objects").open("wb") as stream:
        np.savez(stream, radius=np.array([print], object))
    with pytest.raises(ImageError, match="radius is no array of numbers") as caught:
        read_records(tmp_path / "objects", "scene")
    assert "allow_pickle" not in str(caught.value)


@pytest.mark.parametrize("damage", ["missing", "text", "truncated", "pickle", "array missing", "not finite", "too far"])
def test_a_broken_file_is_an_error(saved: tuple[Path, Image], tmp_path: Path, damage: str) -> None:
    path, whole = tmp_path / "broken", saved[0].read_bytes()
    with np.load(saved[0], allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    if damage == "text":
        path.write_text("no records")
    elif damage == "truncated":
        path.write_bytes(whole[: len(whole) // 2])
    elif damage == "pickle":
        arrays["radius"] = np.array([print], object)
    elif damage == "array missing":
        del arrays["radius"]
    elif damage == "not finite":
        arrays["radius"][0] = np.nan
    elif damage == "too far":
        arrays["radius"][0] = 3e38
    if damage in ("pickle", "array missing", "not finite", "too far"):
        with path.open("wb") as stream:
            np.savez(stream, **arrays)
    import json

    with pytest.raises(ImageError, match="broken"):
        read_records(path, json.loads(arrays["header"].tobytes())["scene"])


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "none"
    write_records(path, NO_RECORDS, "scene")
    assert len(read_records(path, "scene")) == 0


class Named:
    """What names a file, and is no Path: as py.path has it, and in bytes os.DirEntry."""

    def __init__(self, path: Path, named: Callable[[Path], str | bytes]) -> None:
        self.path, self._named = path, named

    def __fspath__(self) -> str | bytes:
        return self._named(self.path)


@pytest.mark.parametrize("named", [str, os.fsencode])
def test_files_may_be_named_by_whatever_stands_for_a_path(named: Any, tmp_path: Path) -> None:
    names = ("scene.obj", "image.exr", "a.records", "passes")
    scene, image, records, passes = (Named(tmp_path / name, named) for name in names)
    scene.path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 3 4\n")
    assert wdpm.check(scene).file == str(scene.path)
    settings: dict[str, Any] = {"photons": 500, "spp": 1, "indirect": "cache"}
    small = wdpm.load(scene, size=(8, 8), root=Named(tmp_path, named))
    wdpm.render(small, save_cache=records, **settings).save(image)
    again = wdpm.render(small, load_cache=records, journal=passes, **settings)
    assert load(image).digest() == again.digest()
