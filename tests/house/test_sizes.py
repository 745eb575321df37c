"""Folders, files and functions stay of a size that a reader can hold in mind."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
WINGS = ("scenes", "kernels", "cluster", "wdpm", "tests", "docs")

FOLDER_MODULES = 24
FILE_LINES = 500
FUNCTION_LINES = 80
KERNEL_LINES = 120
"""Of a function in kernels/: a factory holds the functions that it makes."""
PARAMETERS = 12
"""Not counted in kernels/, nor for Warp's kernels elsewhere, whose parameters are the arrays of a launch."""

# What is larger still. These lists only shrink.
LARGE_FOLDERS: set[str] = set()
LARGE_FILES: set[str] = set()
LONG_FUNCTIONS: set[str] = set()
MANY_PARAMETERS = {"wdpm/api.py::render"}
"""wdpm.render is to stay: its keywords are the public interface, an option of the command line each."""


@dataclass(frozen=True)
class Function:
    """One function of a file, with those inside it."""

    name: str
    lines: int
    parameters: int
    is_kernel: bool

    @property
    def longest(self) -> int:
        """How many lines it may have."""
        return KERNEL_LINES if self.name.startswith("kernels/") else FUNCTION_LINES


def sources(root: Path) -> list[Path]:
    """Every Python file, each once: the links in wdpm/ lead to folders that are listed themselves."""
    files = [path for wing in WINGS for path in (root / wing).rglob("*.py")]
    return sorted(path for path in files if not any(parent.is_symlink() for parent in path.parents))


def functions(root: Path, path: Path) -> Iterator[Function]:
    """Every function of a file, methods and inner ones included."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            given = node.args
            names = [
                a.arg for a in (*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg) if a
            ]
            yield Function(
                f"{path.relative_to(root).as_posix()}::{node.name}",
                (node.end_lineno or node.lineno) - node.lineno + 1,
                len([name for name in names if name not in ("self", "cls")]),
                any("wp.kernel" in ast.unparse(decorator) for decorator in node.decorator_list),
            )


def large_folders(root: Path) -> set[str]:
    counts = Counter(path.parent for path in sources(root) if path.name != "__init__.py")
    return {folder.relative_to(root).as_posix() for folder, count in counts.items() if count > FOLDER_MODULES}


def large_files(root: Path) -> set[str]:
    return {
        path.relative_to(root).as_posix() for path in sources(root) if len(path.read_text().splitlines()) > FILE_LINES
    }


def every_function(root: Path) -> list[Function]:
    return [each for path in sources(root) for each in functions(root, path)]


def long_functions(every: list[Function]) -> set[str]:
    return {each.name for each in every if each.lines > each.longest}


def many_parameters(every: list[Function]) -> set[str]:
    return {
        each.name
        for each in every
        if each.parameters > PARAMETERS and not each.is_kernel and not each.name.startswith("kernels/")
    }


@pytest.fixture(scope="module")
def house() -> list[Function]:
    """Every function of wdpm, its tests and its documentation's programs."""
    return every_function(ROOT)


def test_no_folder_has_too_many_modules() -> None:
    assert large_folders(ROOT) - LARGE_FOLDERS == set()


def test_no_file_is_too_long() -> None:
    assert large_files(ROOT) - LARGE_FILES == set()


def test_no_function_is_too_long(house: list[Function]) -> None:
    assert long_functions(house) - LONG_FUNCTIONS == set()


def test_no_function_has_too_many_parameters(house: list[Function]) -> None:
    assert many_parameters(house) - MANY_PARAMETERS == set()


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A tree in which everything is of the largest size that is allowed."""
    (tmp_path / "kernels").mkdir()
    (tmp_path / "wdpm").mkdir()
    names = ", ".join(f"p{i}" for i in range(PARAMETERS))
    (tmp_path / "wdpm" / "file.py").write_text(
        f"class A:\n    def f(self, {names}):\n" + "        pass\n" * (FUNCTION_LINES - 1) + "\n" * (FILE_LINES - 81)
    )
    (tmp_path / "kernels" / "file.py").write_text("def g(x):\n" + "    pass\n" * (KERNEL_LINES - 1))
    for i in range(FOLDER_MODULES - 1):
        (tmp_path / "wdpm" / f"module{i}.py").touch()
    (tmp_path / "wdpm" / "__init__.py").touch()
    return tmp_path


def test_what_is_within_the_limits_passes(tree: Path) -> None:
    every = every_function(tree)
    assert len(every) == 2
    assert (large_folders(tree), large_files(tree), long_functions(every), many_parameters(every)) == (set(),) * 4


def test_one_more_of_each_is_found(tree: Path) -> None:
    (tree / "wdpm" / "one_more.py").touch()
    for name in ("wdpm/file.py", "kernels/file.py"):
        lines = (tree / name).read_text().replace("self, ", "self, more, ").splitlines()
        lines.insert(3, lines[2] if name.startswith("wdpm") else lines[1])
        (tree / name).write_text("\n".join(lines) + "\n")
    assert large_folders(tree) == {"wdpm"}
    assert large_files(tree) == {"wdpm/file.py"}
    assert long_functions(every_function(tree)) == {"wdpm/file.py::f", "kernels/file.py::g"}
    assert many_parameters(every_function(tree)) == {"wdpm/file.py::f"}
