"""Facts about what is installed: wdpm's requirements, and its extras, as its own metadata has them."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from importlib import metadata

from wdpm.doctor.facts import Fact, State

FOR_DEVELOPERS = ("test", "peers", "cuda", "blender", "site", "docs", "handbook")
"""Extras that the doctor does not ask for."""

REQUIREMENT = re.compile(r"^([A-Za-z0-9._-]+)[^;>=<!~]*(?:.*?>=\s*([0-9][0-9.]*))?")
EXTRA = re.compile(r"extra\s*==\s*['\"]([\w-]+)['\"]")
SYSTEM = re.compile(r"sys_platform\s*==\s*['\"]([^'\"]+)['\"]")


@dataclass(frozen=True)
class Requirement:
    """A package that is asked for.

    Attributes:
        least: the oldest version that will do; None for any.
        extra: that asks for it; None for wdpm itself.
    """

    package: str
    least: str | None
    extra: str | None


def requirements_of(lines: list[str]) -> list[Requirement]:
    """What lines of `Requires-Dist` ask for on this system."""
    found = []
    for line in lines:
        wanted, _, marker = line.partition(";")
        match = REQUIREMENT.match(wanted.strip())
        extra, system = EXTRA.search(marker), SYSTEM.search(marker)
        if match is not None and (system is None or system[1] == sys.platform):
            found.append(Requirement(match[1], match[2], None if extra is None else extra[1]))
    return found


def packages() -> list[Fact]:
    """wdpm's version, and each requirement: there, too old, or missing; then its extras."""
    try:
        own = metadata.version("wdpm")
        wanted = requirements_of(metadata.requires("wdpm") or [])
    except metadata.PackageNotFoundError:
        advice = "pip install -e . in the checkout, so that it knows its version and what it needs"
        return [Fact("wdpm", "a checkout that is not installed", State.NOTE, advice)]
    facts = [Fact("wdpm", own)]
    facts += [_required(each) for each in wanted if each.extra is None]
    extras = dict.fromkeys(each.extra for each in wanted if each.extra is not None)
    facts += [_extra(name, wanted) for name in extras if name not in FOR_DEVELOPERS]
    return facts


def _required(wanted: Requirement) -> Fact:
    there = _version(wanted.package)
    advice = f"pip install --upgrade '{wanted.package}{f'>={wanted.least}' if wanted.least else ''}'"
    if there is None:
        return Fact(wanted.package, "is missing", State.WRONG, advice)
    if wanted.least is not None and _numbers(there) < _numbers(wanted.least):
        return Fact(wanted.package, f"{there}, older than {wanted.least}", State.WRONG, advice)
    return Fact(wanted.package, there)


def _extra(name: str, wanted: list[Requirement]) -> Fact:
    """An extra is there where all of its packages are."""
    packages = [each.package for each in wanted if each.extra == name]
    missing = [package for package in packages if _version(package) is None]
    if missing:
        found = f"not there: {', '.join(missing)}"
        return Fact(f"extra {name}", found, State.NOTE, f"pip install 'wdpm[{name}]', if you want it")
    return Fact(f"extra {name}", ", ".join(f"{package} {_version(package)}" for package in packages))


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _numbers(version: str) -> tuple[int, ...]:
    """The numbers that a version begins with, to be compared."""
    match = re.match(r"\d+(\.\d+)*", version)
    return tuple(map(int, match[0].split("."))) if match else ()
