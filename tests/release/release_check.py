"""What must hold before a release, as a script: `make release-check`.

It looks at the version in all places that have it, the changelog, the contents of the wheel, and a report of the tests
(JUnit's XML, as pytest writes it): which ran, which failed, and which of those that are easily skipped were.
"""

from __future__ import annotations

import argparse
import re
import sys
import tomllib
import xml.etree.ElementTree as ElementTree
import zipfile
from collections.abc import Iterable, Iterator
from email.parser import Parser
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

VERSION = re.compile(r"\d+\.\d+\.\d+")

MUST_RUN = {
    "tests.view.test_page": "a Chromium with its driver",
    "tests.notebook.test_tutorial": "make test-notebook",
    "tests.cli.test_completion": "the extra completion",
    "tests.cluster": "free ports of this machine",
    "tests.shared": "WDPM_SCENES",
    "tests.scenes.against_mitsuba.test_scene_against_mitsuba": "the extra peers",
}
"""Modules of tests, or folders, of which at least one must have run; and what they are skipped without."""

NOT_IN_WHEELS = ("tests/", "docs/")
BESIDE_CODE = ("wdpm/py.typed", "wdpm/view/page/index.html", "wdpm/scenes/mitsuba/sky_data.npz")


def version_of(root: Path) -> str:
    """The one place that the version is in."""
    version: str = tomllib.loads((root / "pyproject.toml").read_text())["project"]["version"]
    return version


def check_version(root: Path) -> Iterator[str]:
    """That all texts that name the version name this one."""
    version = version_of(root)
    if not VERSION.fullmatch(version):
        yield f"pyproject.toml: version '{version}' is not MAJOR.MINOR.PATCH"
    cited = re.search(r"^version:\s*(\S+)$", (root / "CITATION.cff").read_text(), re.MULTILINE)
    if cited is None or cited[1] != version:
        yield f"CITATION.cff: version is {cited[1] if cited else 'missing'}; expected {version}"


def check_changelog(root: Path) -> Iterator[str]:
    """That the changelog begins with this version, says when, and says something."""
    headings = re.split(r"^## ", (root / "CHANGELOG.md").read_text(), flags=re.MULTILINE)[1:]
    if not headings:
        yield "CHANGELOG.md: has no section; expected '## VERSION, YEAR-MONTH-DAY'"
        return
    title, _, body = headings[0].partition("\n")
    expected = version_of(root)
    if not re.fullmatch(rf"{re.escape(expected)}, \d{{4}}-\d{{2}}-\d{{2}}", title):
        yield f"CHANGELOG.md: its first section is '{title}'; expected '{expected}, YEAR-MONTH-DAY'"
    lines = [line for line in body.splitlines() if line.startswith("* ")]
    if not lines:
        yield f"CHANGELOG.md: its section {expected} lists nothing"
    for line in sorted({line for line in lines if lines.count(line) > 1}):
        yield f"CHANGELOG.md: says twice '{line}'"


def check_wheel(wheel: Path, root: Path) -> Iterator[str]:
    """That a wheel has every package, what lies beside the code, the licence, and nothing else."""
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        infos = [name for name in names if name.endswith(".dist-info/METADATA")]
        metadata = Parser().parsestr(archive.read(infos[0]).decode()) if infos else None
    if metadata is None or metadata["Version"] != version_of(root):
        yield f"{wheel.name}: its version is not {version_of(root)}"
    setuptools = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["setuptools"]
    wanted = [f"{package.replace('.', '/')}/__init__.py" for package in setuptools["packages"]]
    for name in [*wanted, *BESIDE_CODE]:
        if name not in names:
            yield f"{wheel.name}: lacks {name}"
    if not any(name.endswith("/LICENSE") for name in names):
        yield f"{wheel.name}: lacks the licence"
    for name in sorted(names):
        if name.startswith(NOT_IN_WHEELS) or not name.startswith("wdpm"):
            yield f"{wheel.name}: has {name}, which is not the program's"


def check_tests(report: Path) -> Iterator[str]:
    """That no test failed, and that those that are easily skipped were not."""
    try:
        cases = list(ElementTree.parse(report).iter("testcase"))
    except (OSError, ElementTree.ParseError) as error:
        yield f"{report}: no report of tests ({error}); run `make release-check`, which writes one"
        return
    failed = [case for case in cases if case.find("failure") is not None or case.find("error") is not None]
    for case in failed:
        yield f"failed: {case.get('classname')}::{case.get('name')}"
    ran = {case.get("classname", "") for case in cases if case.find("skipped") is None}
    for module, needs in MUST_RUN.items():
        if not any(name == module or name.startswith(f"{module}.") for name in ran):
            yield f"not one test of {module} ran: it needs {needs}"


def main(arguments: Iterable[str] | None = None) -> int:
    """Print what does not hold; returns the exit code."""
    parser = argparse.ArgumentParser(description="What must hold before a release.")
    parser.add_argument("--wheel", type=Path, required=True, help="folder with the wheel, and nothing but it")
    parser.add_argument("--tests", type=Path, required=True, help="report of the tests, JUnit's XML")
    args = parser.parse_args(None if arguments is None else list(arguments))
    wheels = sorted(args.wheel.glob("*.whl"))
    wrong = [*check_version(ROOT), *check_changelog(ROOT), *check_tests(args.tests)]
    if len(wheels) == 1:
        wrong += check_wheel(wheels[0], ROOT)
    else:
        wrong.append(f"{args.wheel}: has {len(wheels)} wheels; expected one")
    for line in wrong:
        print(f"release: {line}", file=sys.stderr)
    print(f"{version_of(ROOT)}: {f'{len(wrong)} things to do' if wrong else 'ready; tag it'}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
