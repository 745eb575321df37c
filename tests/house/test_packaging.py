"""The house: what is installed, and that nothing is unpickled. Directions of imports: test_imports.py."""

from __future__ import annotations

import ast
import tomllib
from collections import Counter
from importlib import import_module
from pathlib import Path

import pytest

import wdpm

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("scenes", "kernels", "cluster", "wdpm")


def pyproject() -> dict:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


def sources(room: str) -> list[Path]:
    return sorted((ROOT / room).rglob("*.py"))


ALL_SOURCES = [(room, path) for room in ROOMS for path in sources(room)]
EVERY_SOURCE = pytest.mark.parametrize(
    ("room", "path"), ALL_SOURCES, ids=[path.relative_to(ROOT).as_posix() for _, path in ALL_SOURCES]
)


@EVERY_SOURCE
def test_nothing_is_unpickled_by_numpy(room: str, path: Path) -> None:  # noqa: ARG001
    calls = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)]
    allowed = [
        k for call in calls for k in call.keywords if k.arg == "allow_pickle" and ast.unparse(k.value) != "False"
    ]
    assert allowed == []


def test_every_file_of_tests_has_a_name_of_its_own() -> None:
    names = Counter(path.stem for path in (ROOT / "tests").rglob("test_*.py"))
    assert [name for name, count in names.items() if count > 1] == []  # pytest imports them by that alone


def test_every_package_is_listed() -> None:
    setuptools = pyproject()["tool"]["setuptools"]
    folders = [path.parent.relative_to(ROOT) for room in ROOMS for path in (ROOT / room).rglob("__init__.py")]
    in_tree = {".".join(folder.parts if folder.parts[0] == "wdpm" else ("wdpm", *folder.parts)) for folder in folders}
    assert setuptools["package-dir"] == {"wdpm" if room == "wdpm" else f"wdpm.{room}": room for room in ROOMS}
    assert setuptools["packages"] == sorted(in_tree)


@pytest.mark.parametrize("room", ROOMS)
def test_every_folder_is_a_package(room: str) -> None:
    """One without __init__.py would be missing from wheels."""
    assert [path for path in sources(room) if not (path.parent / "__init__.py").exists()] == []


def test_no_package_hides_a_public_name() -> None:
    """Importing wdpm.render, the package, would put it in the place of wdpm.render, the function."""
    packages = {path.parent.name for path in ROOT.glob("wdpm/*/__init__.py")}
    assert packages & set(wdpm.__all__) == {"scenes"}


@pytest.mark.parametrize("room", ["scenes", "kernels", "cluster"])
def test_the_links_for_people_and_type_checkers(room: str) -> None:
    link = ROOT / "wdpm" / room
    assert link.is_symlink()
    assert link.readlink() == Path("..") / room


def test_the_command_exists() -> None:
    module, function = pyproject()["project"]["scripts"]["wdpm"].split(":")
    assert callable(getattr(import_module(module), function))


def test_the_licence_is_the_one_declared() -> None:
    assert pyproject()["project"]["license"] == "Apache-2.0"
    text = (ROOT / "LICENSE").read_text()
    assert "Apache License" in text
    assert "Version 2.0, January 2004" in text
    assert "END OF TERMS AND CONDITIONS" in text
