"""The release check finds what must not be released, and what is here would pass but for the date."""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path

import pytest
from release_check import (
    BESIDE_CODE,
    MUST_RUN,
    ROOT,
    check_changelog,
    check_tests,
    check_version,
    check_wheel,
    main,
    version_of,
)

PROJECT = '[project]\nversion = "1.2.3"\n[tool.setuptools]\npackages = ["wdpm", "wdpm.cli"]\n'
GOOD = ["wdpm/__init__.py", "wdpm/cli/__init__.py", *BESIDE_CODE, "wdpm-1.2.3.dist-info/licenses/LICENSE"]


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A repository that is ready."""
    (tmp_path / "pyproject.toml").write_text(PROJECT)
    (tmp_path / "CITATION.cff").write_text("cff-version: 1.2.0\nversion: 1.2.3\n")
    (tmp_path / "CHANGELOG.md").write_text("# Changes\n\n## 1.2.3, 2026-11-22\n\n* More.\n\n## 1.2.2, 2026-01-01\n")
    return tmp_path


def wheel(root: Path, names: list[str], version: str = "1.2.3") -> Path:
    path = root / "wdpm-1.2.3-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for name in names:
            archive.writestr(name, "")
        archive.writestr("wdpm-1.2.3.dist-info/METADATA", f"Name: wdpm\nVersion: {version}\n")
    return path


def report(root: Path, *cases: str) -> Path:
    path = root / "tests.xml"
    path.write_text(f"<testsuites><testsuite>{''.join(cases)}</testsuite></testsuites>")
    return path


def case(module: str, inside: str = "") -> str:
    return f'<testcase classname="{module}" name="test_x">{inside}</testcase>'


def test_what_is_ready_passes(root: Path) -> None:
    tests = report(root, *(case(f"{module}.deeper") for module in MUST_RUN))
    assert [*check_version(root), *check_changelog(root), *check_wheel(wheel(root, GOOD), root)] == []
    assert list(check_tests(tests)) == []


def test_this_repository_is_of_one_version() -> None:
    assert list(check_version(ROOT)) == []
    assert version_of(ROOT) in (ROOT / "CHANGELOG.md").read_text().split("## ")[1]


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("pyproject.toml", PROJECT.replace("1.2.3", "1.2"), "'1.2' is not MAJOR.MINOR.PATCH"),
        ("CITATION.cff", "version: 1.2.2\n", "version is 1.2.2; expected 1.2.3"),
        ("CITATION.cff", "", "version is missing"),
        ("CHANGELOG.md", "# Changes\n", "has no section"),
        ("CHANGELOG.md", "## 1.2.3, not released yet\n\n* A.\n", "expected '1.2.3, YEAR-MONTH-DAY'"),
        ("CHANGELOG.md", "## 1.2.3, 2026-11-22\n", "lists nothing"),
        ("CHANGELOG.md", "## 1.2.3, 2026-11-22\n\n* A.\n* A.\n", "says twice '* A.'"),
    ],
)
def test_texts_that_do_not_agree(root: Path, file: str, text: str, message: str) -> None:
    (root / file).write_text(text)
    assert any(message in line for line in [*check_version(root), *check_changelog(root)])


def test_wheels_that_are_not_whole(root: Path) -> None:
    assert any("lacks wdpm/cli/__init__.py" in line for line in check_wheel(wheel(root, GOOD[:1]), root))
    assert any("lacks the licence" in line for line in check_wheel(wheel(root, GOOD[:-1]), root))
    assert any("has tests/x.py" in line for line in check_wheel(wheel(root, [*GOOD, "tests/x.py"]), root))
    assert any("version is not 1.2.3" in line for line in check_wheel(wheel(root, GOOD, "1.2.2"), root))


def test_tests_that_failed_or_did_not_run(root: Path) -> None:
    cases = [case(module) for module in MUST_RUN]
    failed = report(root, *cases, case("tests.x", "<failure/>"))
    assert list(check_tests(failed)) == ["failed: tests.x::test_x"]
    skipped = report(root, *cases[1:], case(next(iter(MUST_RUN)), "<skipped/>"))
    assert len(list(check_tests(skipped))) == 1
    assert "no report of tests" in next(iter(check_tests(root / "none.xml")))


def test_the_modules_that_must_run_exist() -> None:
    for module in MUST_RUN:
        path = ROOT / Path(*module.split("."))
        assert path.is_dir() or path.with_suffix(".py").is_file(), module


def test_the_script_tells_what_is_to_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.rmtree(tmp_path / "dist", ignore_errors=True)
    assert main(["--wheel", str(tmp_path), "--tests", str(tmp_path / "none.xml")]) == 1
    told = capsys.readouterr()
    assert f"release: {tmp_path}: has 0 wheels; expected one" in told.err
    assert "things to do" in told.out
