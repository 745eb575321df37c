"""Irradiance records in a file: for other views of the scene, on any cluster, and never anything but records."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import wdpm
from wdpm.api import render
from wdpm.cache_file import read_records, write_records
from wdpm.cluster.records import NO_RECORDS
from wdpm.image import Image
from wdpm.kernels.settings import Indirect
from wdpm.scenes.errors import ImageError, SettingsError
from wdpm.scenes.model import Scene

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


@pytest.mark.parametrize("other", [{"photons": 5000}, {"seed": 1}, {"k": 20}, {"max_depth": 4}])
def test_records_of_other_photons_are_refused(box: Scene, saved: tuple[Path, Image], other: dict[str, int]) -> None:
    with pytest.raises(ImageError, match="of another scene, or of other photons"):
        render(box, load_cache=saved[0], **{**FEW, **other})


def test_a_render_without_a_cache_is_refused(box: Scene, tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"--save-cache.*--indirect cache"):
        render(box, save_cache=tmp_path / "x", **{**FEW, "indirect": Indirect.MAP})
    with pytest.raises(SettingsError, match="records of its own"):
        render(box, save_cache=tmp_path / "x", passes=2, **FEW)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("damage", ["missing", "text", "truncated", "pickle", "array missing", "not finite"])
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
    if damage in ("pickle", "array missing", "not finite"):
        with path.open("wb") as stream:
            np.savez(stream, **arrays)
    import json

    with pytest.raises(ImageError, match="broken"):
        read_records(path, json.loads(arrays["header"].tobytes())["scene"])


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "none"
    write_records(path, NO_RECORDS, "scene")
    assert len(read_records(path, "scene")) == 0
