"""The file that Blender installs; without Blender."""

from __future__ import annotations

import sys
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

from wdpm.blender.extension import BLENDERS_OWN, manifest, platforms_of, write_extension
from wdpm.cli.main import main
from wdpm.scenes.errors import SettingsError


def wheels_of_everything(folder: Path) -> list[str]:
    """Empty files with the names that wheels of wdpm and of what it needs have."""
    needed = [line.split(">")[0] for line in metadata.requires("wdpm") or () if "extra" not in line]
    names = [f"{name.replace('-', '_')}-1.0-cp311-cp311-manylinux_2_28_x86_64.whl" for name in needed]
    names += ["wdpm-0.1.0-py3-none-any.whl", "numpy-2.0.0-cp311-cp311-manylinux2014_x86_64.whl"]
    folder.mkdir()
    for name in names:
        (folder / name).write_bytes(b"wheel")
    return sorted(name for name in set(names) if name.split("-")[0] not in BLENDERS_OWN)


def test_a_file_without_wheels(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "wdpm.zip"
    assert main(["blender", str(file)]) == 0
    assert "without wheels" in capsys.readouterr().out
    with zipfile.ZipFile(file) as inside:
        assert sorted(inside.namelist()) == ["__init__.py", "blender_manifest.toml"]
        said = tomllib.loads(inside.read("blender_manifest.toml").decode())
    assert (said["schema_version"], said["id"], said["type"]) == ("1.0.0", "wdpm", "add-on")
    assert "wheels" not in said
    assert len(said["version"].split(".")) == 3


def test_wheels_are_taken_along_but_what_blender_has(tmp_path: Path) -> None:
    expected = wheels_of_everything(tmp_path / "wheels")
    written = write_extension(tmp_path / "wdpm.zip", tmp_path / "wheels")
    assert sorted(written) == expected
    with zipfile.ZipFile(tmp_path / "wdpm.zip") as inside:
        said = tomllib.loads(inside.read("blender_manifest.toml").decode())
        assert {f"wheels/{name}" for name in expected} <= set(inside.namelist())
    assert said["wheels"] == [f"./wheels/{name}" for name in expected]
    assert said["platforms"] == ["linux-x64"]


@pytest.mark.parametrize(
    ("wheel", "platforms"),
    [
        ("a-1-py3-none-any.whl", []),
        ("a-1-cp311-cp311-manylinux_2_17_x86_64.manylinux2014_x86_64.whl", ["linux-x64"]),
        ("a-1-cp311-cp311-manylinux_2_28_aarch64.whl", ["linux-arm64"]),
        ("a-1-cp311-cp311-macosx_11_0_arm64.whl", ["macos-arm64"]),
        ("a-1-cp311-cp311-win_amd64.whl", ["windows-x64"]),
    ],
)
def test_platforms(wheel: str, platforms: list[str]) -> None:
    assert platforms_of(wheel) == platforms


def test_names_with_quotes_stay_toml() -> None:
    assert tomllib.loads(manifest(['a"b-1-py3-none-any.whl']))["wheels"] == ['./wheels/a"b-1-py3-none-any.whl']


def test_a_folder_that_lacks_wheels_is_named(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="no wheels there; make them with  pip wheel"):
        write_extension(tmp_path / "a.zip", tmp_path)
    (tmp_path / "wdpm-0.1.0-py3-none-any.whl").touch()
    with pytest.raises(SettingsError, match=r"lacks wheels of imageio, msgpack, .*, warp-lang"):
        write_extension(tmp_path / "a.zip", tmp_path)
    assert not (tmp_path / "a.zip").exists()


@pytest.mark.parametrize(
    ("name", "message"),
    [("a.tar", "Blender installs .zip files"), ("no/a.zip", "cannot be written"), ("b.zip", "already")],
)
def test_files_that_cannot_be_written(
    tmp_path: Path, name: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "b.zip").touch()
    assert main(["blender", str(tmp_path / name)]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert len(said.splitlines()) == 1


def test_the_package_is_imported_without_blender(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "bpy", None)
    for name in ("wdpm.blender", "wdpm.blender.extension", "wdpm.blender.layers", "wdpm.blender.export.scene"):
        __import__(name)
    monkeypatch.delitem(sys.modules, "wdpm.blender.settings", raising=False)
    with pytest.raises(ModuleNotFoundError, match="bpy"):
        __import__("wdpm.blender.settings")
