"""Every guard that the table lists is there, once, and so are its tests. `make guards` shows that they fail without."""

from __future__ import annotations

import ast
import importlib

import pytest
from guard import ROOT, Guard, every_guard
from remove_guards import table

GUARDS = every_guard()
PAGE = ROOT / "docs" / "hard-cases.md"


def test_names_are_unique() -> None:
    names = [guard.name for guard in GUARDS]
    assert len(names) == len(set(names))


@pytest.mark.parametrize("guard", GUARDS, ids=lambda guard: guard.name)
def test_the_guard_is_there_and_can_be_taken_away(guard: Guard) -> None:
    source = (ROOT / guard.file).read_text(encoding="utf-8")
    without = guard.removed_from(source)
    assert without != source
    ast.parse(without)


@pytest.fixture
def hard_cases(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Names of all hard cases."""
    monkeypatch.syspath_prepend(ROOT / "tests" / "hard_cases")
    return {case.name for case in importlib.import_module("case").every_case()}


@pytest.mark.parametrize("guard", GUARDS, ids=lambda guard: guard.name)
def test_its_tests_are_there(guard: Guard, hard_cases: set[str]) -> None:
    assert guard.tests
    for test in guard.tests:
        file, _, function = test.partition("::")
        name, _, parameter = function.partition("[")
        assert f"def {name}(" in (ROOT / file).read_text(encoding="utf-8")
        assert not parameter or parameter.removesuffix("]") in hard_cases


def test_what_is_not_there_is_noticed() -> None:
    gone = Guard(name="gone", file="kernels/rays/bvh.py", prevents="", changes=(("no such text", ""),), tests=())
    with pytest.raises(ValueError, match='0 times "no such text"'):
        gone.removed_from("source")


def test_the_page_has_the_table_as_it_is() -> None:
    """`python tests/guards/remove_guards.py --table` prints it."""
    assert table() in PAGE.read_text(encoding="utf-8")
