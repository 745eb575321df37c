"""The file that Blender installs: an extension with its manifest, and the wheels that it needs or none.

Format: Blender's manual, "Extensions", manifest schema 1.0.0. Wheels that lie in the file are unpacked by Blender, so
the person needs neither pip nor a network; without them, wdpm has to be installed into Blender's Python beforehand.
"""

from __future__ import annotations

import json
import re
import zipfile
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

from wdpm.scenes.errors import SettingsError

BLENDER_LEAST = "4.5.0"
"""The oldest Blender that this was tried with."""

BLENDERS_OWN = frozenset({"numpy"})
"""Packages that Blender brings along; another version beside them would be in the way of other add-ons."""

INIT = '''"""wdpm as a render engine."""

try:
    from wdpm.blender.addon import register, unregister
except ModuleNotFoundError as error:
    import sys

    raise ImportError(
        f"{error.name} is missing in Blender's Python: run  {sys.executable} -m pip install wdpm  and switch the "
        "add-on on again, or install a file made with  wdpm blender FILE.zip --wheels FOLDER"
    ) from None

__all__ = ["register", "unregister"]
'''

_PLATFORMS = (
    (re.compile(r"linux.*_x86_64$"), "linux-x64"),
    (re.compile(r"linux.*_aarch64$"), "linux-arm64"),
    (re.compile(r"macosx_\d+_\d+_(arm64|universal2)$"), "macos-arm64"),
    (re.compile(r"macosx_\d+_\d+_x86_64$"), "macos-x64"),
    (re.compile(r"win_amd64$"), "windows-x64"),
    (re.compile(r"win_arm64$"), "windows-arm64"),
)
"""How the platform of a wheel ends, and Blender's name for it."""


def write_extension(path: Path, wheels: Path | None = None) -> tuple[str, ...]:
    """Write the file.

    Args:
        path: a .zip that is not there yet.
        wheels: folder of the wheels to put into it, for one platform; None for none.

    Returns:
        Names of the wheels that went in.

    Raises:
        SettingsError: the path is no .zip or cannot be written, or the folder lacks what wdpm needs.
    """
    if path.suffix != ".zip":
        raise SettingsError(f"{path}: Blender installs .zip files; give a name that ends so")
    found = () if wheels is None else _wheels_in(wheels)
    try:
        with zipfile.ZipFile(path, "x", zipfile.ZIP_DEFLATED) as file:
            file.writestr("blender_manifest.toml", manifest([each.name for each in found]))
            file.writestr("__init__.py", INIT)
            for each in found:
                file.write(each, f"wheels/{each.name}", zipfile.ZIP_STORED)
    except FileExistsError:
        raise SettingsError(f"{path}: there is such a file already; give another name or delete it") from None
    except OSError as error:
        raise SettingsError(f"{path}: cannot be written ({error.strerror})") from None
    return tuple(each.name for each in found)


def manifest(wheels: Sequence[str] = ()) -> str:
    """The manifest, in TOML.

    Args:
        wheels: names of the wheels in the file.
    """
    lines = {
        "schema_version": "1.0.0",
        "id": "wdpm",
        "version": _version(),
        "name": "wdpm",
        "tagline": "Photon mapping on this computer or a cluster, with caustics",
        "maintainer": "the wdpm project",
        "type": "add-on",
        "blender_version_min": BLENDER_LEAST,
        "license": ["SPDX:Apache-2.0"],
        "tags": ["Render"],
    }
    platforms = sorted({name for wheel in wheels for name in platforms_of(wheel)})
    if platforms:
        lines["platforms"] = platforms
    if wheels:
        lines["wheels"] = [f"./wheels/{wheel}" for wheel in sorted(wheels)]
    # Strings and lists of strings are written alike in JSON and TOML.
    text = "".join(f"{key} = {json.dumps(value)}\n" for key, value in lines.items())
    permissions = {
        "network": "Talk to the slaves of a cluster",
        "files": "Keep compiled kernels, and read images and keys",
    }
    return f"{text}\n[permissions]\n" + "".join(f"{key} = {json.dumps(why)}\n" for key, why in permissions.items())


def platforms_of(wheel: str) -> list[str]:
    """Blender's names of the platforms that a wheel is for; none where it runs everywhere."""
    tags = wheel.removesuffix(".whl").rsplit("-", 1)[-1].split(".")
    return [name for ending, name in _PLATFORMS if any(ending.search(tag) for tag in tags)]


def _version() -> str:
    """Ours, as three numbers, which is what Blender wants."""
    try:
        numbers = re.findall(r"\d+", metadata.version("wdpm"))
    except metadata.PackageNotFoundError:  # a checkout that is not installed
        numbers = []
    return ".".join([*numbers, "0", "0", "0"][:3])


def _wheels_in(folder: Path) -> tuple[Path, ...]:
    """The wheels of a folder that the extension takes along.

    Raises:
        SettingsError: wdpm or one of the packages that it needs is not there.
    """
    every = sorted(folder.glob("*.whl"))
    if not every:
        raise SettingsError(f"{folder}: no wheels there; make them with  pip wheel --wheel-dir {folder} wdpm")
    names = {_package(each.name.split("-")[0]): each for each in every}
    needed = {
        _package(re.split(r"[^\w.-]", line)[0]) for line in metadata.requires("wdpm") or () if "extra" not in line
    }
    missing = sorted(({"wdpm"} | needed) - names.keys() - BLENDERS_OWN)
    if missing:
        raise SettingsError(f"{folder}: lacks wheels of {', '.join(missing)}; make them with pip wheel, in Python 3.11")
    return tuple(wheel for name, wheel in names.items() if name not in BLENDERS_OWN)


def _package(name: str) -> str:
    """A package's name as the index writes it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()
