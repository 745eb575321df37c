"""What the documentation and the comments mention exists: files, headings, modules, names of code."""

from __future__ import annotations

import ast
import re
from functools import cache
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("scenes", "kernels", "cluster", "wdpm", "tests", "docs")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
EVERY_PAGE = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)

LINK = re.compile(r"!?\[([^\]]*)\]\(([^)\s]+)\)")
FILE = re.compile(r"(?<![\w/<*.{}-])((?:[\w-]+/)*[\w-]+\.(?:py|md|toml))\b")
DOTTED = re.compile(r"(?<![\w./-])wdpm(?:\.[A-Za-z_]\w*)+(?!\w*[(/])")
NAME = re.compile(r"\b[A-Za-z]\w*_\w+\b")
CODE = re.compile(r"`([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)(?:\(\))?`")

WORD = re.compile(r"[^\W\d]\w*")
NOT_CODE = re.compile(
    r"""(#[^\n]*)|'{3}(?:\\.|[^\\])*?'{3}|"{3}(?:\\.|[^\\])*?"{3}|'(?:\\.|[^'\\])*'|"(?:\\.|[^"\\])*\"""", re.DOTALL
)
"""A comment (which is found), or a string."""

SUBSCRIPT = re.compile(r"\w+_\w²?")
"""A quantity of a formula: x_i, theta_x."""

FOREIGN = {
    "EX_TEMPFAIL",  # of sysexits.h
    "EXR_ERR_",  # OpenEXR's error codes begin so
    "RECONNECT_IVL",  # an option of ZeroMQ's sockets, ZMQ_ in front
    "SECONDS_PER_TASK",  # what a program's arguments are
    "emissive_strength",  # a glTF extension
    "export_apply",  # Blender's exporter, and what it is told
    "export_cameras",
    "export_lights",
    "export_scene",
    "pdf_solid_angle",  # the field's word for the density that our `pdf`s are
    "proc_pid_stat",  # a page of the Linux manual
    "rotation_i",
    "stb_image",  # a library
    "vertex_foo",  # how PLY files name attributes
    "vertex_foo_color",
    "write_bitmap",  # Mitsuba's
    "x86_64",
}
"""Names in our prose that are nobody's in our code."""

EXAMPLES = {"foo", "scene.py"}


@cache
def files() -> frozenset[str]:
    """All files of the repository that a text may speak of, by their paths from its root."""
    inside = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*") if path.is_file()]
    every = [*ROOT.glob("*"), *inside]
    return frozenset(path.relative_to(ROOT).as_posix() for path in every if "__pycache__" not in path.parts)


def exists(path: str) -> bool:
    """Whether a file ends like that: texts may leave out the folders that its context says."""
    return any(each == path or each.endswith(f"/{path}") for each in files())


def python_files() -> list[Path]:
    return sorted(ROOT / each for each in files() if each.endswith(".py"))


class Code(NamedTuple):
    """All Python files, read once.

    Attributes:
        names: that code uses or has in its strings.
        prose: of each file: docstrings and comments.
        second_docstrings: places where one docstring follows another.
    """

    names: frozenset[str]
    prose: dict[str, str]
    second_docstrings: list[str]


@cache
def read_code() -> Code:
    names: set[str] = set()
    prose: dict[str, str] = {}
    twice: list[str] = []
    for path in python_files():
        source = path.read_text()
        nodes = list(ast.walk(ast.parse(source)))
        blocks = [body for node in nodes if isinstance(body := getattr(node, "body", None), list)]
        docs = {id(each.value): each.value.value for body in blocks for each in body if is_text(each)}
        pairs = [pair for body in blocks for pair in pairwise(body) if all(map(is_text, pair))]
        twice += [f"{path.relative_to(ROOT)}:{second.lineno}" for _, second in pairs]
        names.update(WORD.findall(NOT_CODE.sub(" ", source)))
        if path != Path(__file__):
            strings = {node.value for node in nodes if isinstance(node, ast.Constant) and id(node) not in docs}
            names.update(*(WORD.findall(each) for each in strings if isinstance(each, str)))
        names.update(path.relative_to(ROOT).with_suffix("").parts)
        prose[path.relative_to(ROOT).as_posix()] = "\n".join([*docs.values(), *NOT_CODE.findall(source)])
    return Code(frozenset(names), prose, twice)


def is_text(node: ast.AST) -> bool:
    """A string that stands alone: of a module, class or function, or below a constant."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def missing_files(text: str) -> list[str]:
    return [name for name in FILE.findall(text) if not exists(name) and name not in EXAMPLES]


def unknown_names(text: str) -> list[str]:
    """Words that look like names of code and are none."""
    names = read_code().names
    words = {word for word in NAME.findall(text) if not word.startswith("foo_")}
    return sorted(word for word in words - names - FOREIGN if not SUBSCRIPT.fullmatch(word))


def unresolved(text: str) -> list[str]:
    """Dotted names of wdpm that lead nowhere."""
    return [name for name in DOTTED.findall(text) if not FILE.fullmatch(name) and not resolves(name)]


@cache
def resolves(name: str) -> bool:
    parts = name.split(".")
    for end in range(len(parts), 0, -1):
        try:
            found: Any = import_module(".".join(parts[:end]))
        except ModuleNotFoundError:
            continue
        for attribute in parts[end:]:
            if not hasattr(found, attribute):
                return attribute in getattr(found, "__annotations__", {})
            found = getattr(found, attribute)
        return True
    return False


def headings(page: Path) -> set[str]:
    """The anchors of a page, as they are made of its headings."""
    lines = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE).splitlines()
    titles = [line.lstrip("#").strip() for line in lines if line.startswith("#")]
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@EVERY_PAGE
def test_links_lead_somewhere(page: Path) -> None:
    for text, link in LINK.findall(page.read_text()):
        if re.match(r"\w+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), link
        if anchor and target.suffix == ".md":
            assert anchor in headings(target), link
        name = text.strip("`")
        if FILE.fullmatch(name) and target.is_file():
            assert target.as_posix().endswith(f"/{name}"), f"{text} links to {path}"


@EVERY_PAGE
def test_files_that_pages_mention_exist(page: Path) -> None:
    assert missing_files(page.read_text()) == []


@EVERY_PAGE
def test_names_that_pages_mention_exist(page: Path) -> None:
    text = page.read_text()
    assert unknown_names(text) == []
    assert unresolved(text) == []


@EVERY_PAGE
def test_code_that_pages_quote_exists(page: Path) -> None:
    """In backticks: what is dotted or written like a class."""
    names = read_code().names
    quoted = {name for name in CODE.findall(page.read_text()) if "." in name or re.search(r"[a-z][A-Z]", name)}
    assert [name for name in sorted(quoted) if not exists(name) and not set(name.split(".")) <= names] == []


def test_files_that_code_mentions_exist() -> None:
    found = {path: missing_files(text) for path, text in read_code().prose.items()}
    assert {path: names for path, names in found.items() if names} == {}


def test_names_that_code_mentions_exist() -> None:
    found = {path: unknown_names(text) + unresolved(text) for path, text in read_code().prose.items()}
    assert {path: names for path, names in found.items() if names} == {}


def test_no_name_has_two_docstrings() -> None:
    """The second belonged to a name that has moved."""
    assert read_code().second_docstrings == []


def test_foreign_names_are_still_mentioned() -> None:
    text = "\n".join([*read_code().prose.values(), *(page.read_text() for page in PAGES)])
    assert {name for name in FOREIGN if not re.search(rf"\b{name}\b", text)} == set()


@pytest.mark.parametrize(
    ("find", "text"),
    [
        (missing_files, "see kernels/camera_light.py"),
        (missing_files, "see sockets_master.py)"),
        (unknown_names, "by master_phases, which"),
        (unresolved, "by wdpm.kernels.no_such_module"),
        (unresolved, "by wdpm.api.no_such_function"),
    ],
)
def test_what_is_stale_is_found(find: Any, text: str) -> None:
    assert len(find(text)) == 1


def test_what_exists_is_not() -> None:
    text = "wdpm.kernels.rays.bvh, wdpm.Cluster.local, rays/bvh.py, closest_hit and x_i"
    assert (missing_files(text), unknown_names(text), unresolved(text)) == ([], [], [])
