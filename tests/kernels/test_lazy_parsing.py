"""Functions of kernels that are parsed late are those that Warp makes at once."""

from __future__ import annotations

import ast
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
import warp as wp

from wdpm.kernels import lazy_parsing

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NAMES = """
import sys
if not sys.argv[1]:
    import wdpm.kernels  # before Warp, whose own functions are then late as well
import warp as wp
wp.__version__ = sys.argv[1] or wp.__version__
from wdpm.kernels.compile import kernels_for_all_scenes
for module in kernels_for_all_scenes():
    name = module.get_module_identifier(1)
    print("NAME", name, *sorted(kernel.get_mangled_name() for kernel in module.kernels.values()))
"""

PARSED = """
import sys
from wdpm.kernels import lazy_parsing
import wdpm.kernels.compile
from wdpm.kernels.compile import ready_kernels
from wdpm.kernels.features import Features
parsed = []
finish = lazy_parsing._finish
lazy_parsing._finish = lambda function: parsed.append(function.key) or finish(function)
ready_kernels("cpu", Features())
print("PARSED", len(parsed))
"""


def said(program: str, *arguments: str) -> list[str]:
    """What a program in a process of its own says, but for Warp."""
    done = subprocess.run([sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=True)
    return [line for line in done.stdout.splitlines() if line.startswith(("NAME", "PARSED"))]


@pytest.fixture
def ours(monkeypatch: pytest.MonkeyPatch) -> None:
    """The functions of this file are taken for those of kernels."""
    monkeypatch.setattr(lazy_parsing, "OF", __name__)


def test_names_of_all_modules_and_kernels_are_those_that_warp_gives_at_once() -> None:
    """So what is compiled is the same. A Warp that was not tried makes all functions at once."""
    late_names, names = said(NAMES, ""), said(NAMES, "9.0.0")
    assert len(names) > 30
    assert late_names == names


def numbers_of_warp_with_members(function: ast.FunctionDef) -> Iterator[str]:
    """Variables of a function whose members it uses, and that are named as a number of Warp's."""
    names = [node for node in ast.walk(function) if isinstance(node, ast.Name)]
    own = {node.id for node in names if isinstance(node.ctx, ast.Store)}
    of_members = [node.value for node in ast.walk(function) if isinstance(node, ast.Attribute)]
    for name in {node.id for node in of_members if isinstance(node, ast.Name)} & own:
        if isinstance(getattr(wp, name, None), (int, float)):
            yield name


def test_no_struct_is_named_as_a_number_of_warp() -> None:
    """`e.flux` is taken for Euler's number until the function is compiled: its hash, and its name, would change then,
    and a process that compiles it before it makes another that calls it gives that another name than one that does
    not."""
    kernels = Path(lazy_parsing.__file__).parent
    functions = [
        (path.name, node)
        for path in sorted(kernels.rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef)
    ]
    assert len(functions) > 500
    clashes = [f"{name}: {at.name}: {each}" for name, at in functions for each in numbers_of_warp_with_members(at)]
    assert clashes == []


def test_no_function_is_parsed_where_all_is_compiled_and_remembered() -> None:
    said(PARSED)
    assert said(PARSED) == ["PARSED 0"]


@pytest.mark.usefixtures("ours")
def test_functions_can_be_called_from_python() -> None:
    @wp.func
    def doubled(x: wp.float32) -> wp.float32:
        return 2.0 * x

    assert type(doubled) is not wp.Function
    assert doubled(21.0) == 42.0
    assert type(doubled) is wp.Function


@pytest.mark.usefixtures("ours")
def test_threads_find_a_function_made_or_wait_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Modules are compiled by threads, and have functions in common."""

    @wp.func
    def halved(x: wp.float32) -> wp.float32:
        return 0.5 * x

    at_it, go_on = threading.Event(), threading.Event()
    make = lazy_parsing._make

    def slowly(function: wp.Function, **told: Any) -> None:
        make(function, **told)
        at_it.set()
        assert go_on.wait(60.0)

    monkeypatch.setattr(lazy_parsing, "_make", slowly)
    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(lambda: halved.user_overloads)
        assert at_it.wait(60.0)
        assert "user_overloads" not in vars(halved)  # nobody sees a part of it
        second = pool.submit(lambda: halved.user_overloads)
        go_on.set()
        assert list(first.result().values()) == list(second.result().values()) == [halved]


@pytest.mark.usefixtures("ours")
def test_an_overloaded_function_is_made_at_once() -> None:
    @wp.func
    def twice(x: wp.float32) -> wp.float32:
        return 2.0 * x

    @wp.func
    def twice(x: wp.int32) -> wp.int32:  # noqa: F811
        return 2 * x

    assert (twice(3), twice(1.5)) == (6, 3.0)


@pytest.mark.usefixtures("ours")
def test_what_a_function_has_not_is_missed_as_ever() -> None:
    @wp.func
    def nothing(x: wp.float32) -> wp.float32:
        return x

    with pytest.raises(AttributeError, match="colour"):
        _ = nothing.colour
    assert not hasattr(nothing, "__colour__")


def test_functions_of_others_are_made_at_once() -> None:
    @wp.func
    def mine(x: wp.float32) -> wp.float32:
        return x

    assert type(mine) is wp.Function


@pytest.mark.usefixtures("ours")
def test_to_make_a_function_late_changes_no_hash() -> None:
    """Or every kernel of its module would be hashed again at its next launch."""

    @wp.func
    def added(x: wp.float32) -> wp.float32:
        return x + 1.0

    module = added.module
    hashers = module.hashers
    assert added.adj is not None
    assert module.hashers is hashers
    assert module.functions[added.key] is added
