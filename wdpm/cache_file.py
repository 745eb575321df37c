"""Irradiance records in a file: those of one view, for others of the same scene.

A view that loads them makes none of its own; where none reaches, it traces gather rays. They are data like the scene:
the same file gives the same image, bit for bit, on any cluster. Never unpickled, written whole or not at all.
"""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from wdpm.cluster.checks import check
from wdpm.cluster.records import Records
from wdpm.image_files import write_whole
from wdpm.kernels.settings import Indirect, RenderSettings
from wdpm.scenes.errors import ImageError, ProtocolError, SettingsError

FORMAT = 1
"""Of the file; grows with every change that older or newer code would not understand."""

_HEADER = "header"


@dataclass(frozen=True)
class CacheFiles:
    """Where irradiance records are written to and read from; None for nowhere."""

    save: Path | None = None
    load: Path | None = None


NO_CACHE_FILES = CacheFiles()


def check_wanted(files: CacheFiles, settings: RenderSettings) -> None:
    """Raise SettingsError unless a render with these settings, which leave nothing open, has one set of records."""
    option = "--save-cache" if files.save is not None else "--load-cache"
    if files == NO_CACHE_FILES:
        return
    if not settings.gathers or settings.indirect is not Indirect.CACHE:
        raise SettingsError(
            f"{option}: there is no irradiance cache, since indirect light comes by {settings.indirect.value}; "
            "ask for one by --indirect cache"
        )
    if settings.passes > 1:
        raise SettingsError(
            f"{option}: each of the {settings.passes} passes has irradiance records of its own, so that their errors "
            "average out; render in one pass"
        )


def write_records(path: Path, records: Records, scene: str) -> None:
    """Keep records.

    Args:
        scene: names what they are of (Prepared.identity).

    Raises:
        ImageError: the file cannot be written; an older one is then as it was.
    """
    header = np.frombuffer(json.dumps({"format": FORMAT, "scene": scene}).encode(), np.uint8)

    def write(temporary: Path) -> None:
        with temporary.open("wb") as file:  # a name without .npz would have it appended
            np.savez(file, allow_pickle=False, **{_HEADER: header}, **vars(records))

    try:
        write_whole(path, write)
    except OSError as error:
        raise ImageError(f"{path}: cannot be written: {error.strerror or error}") from None


def read_records(path: Path, scene: str) -> Records:
    """The records of a file.

    Raises:
        ImageError: there is no such file, it is broken, or it is of another scene.
    """
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            arrays: dict[str, Any] = {name: file[name] for name in file.files}
        header = json.loads(arrays.pop(_HEADER).tobytes())
        of_format, of_scene = int(header["format"]), str(header["scene"])
    except FileNotFoundError:
        raise ImageError(f"{path}: no such file; write one by --save-cache") from None
    except (OSError, EOFError, KeyError, TypeError, ValueError, RuntimeError, zipfile.BadZipFile) as error:
        raise ImageError(f"{path}: is no file of irradiance records ({error}); write one by --save-cache") from None
    if of_format != FORMAT:
        raise ImageError(f"{path}: is of format {of_format}, this wdpm has {FORMAT}; write it anew by --save-cache")
    if of_scene != scene:
        raise ImageError(
            f"{path}: its irradiance records are of another scene, or of other photons; only the camera, its samples "
            "and what changes no bit may differ"
        )
    return _records(path, arrays)


def _records(path: Path, arrays: dict[str, Any]) -> Records:
    names = [field.name for field in fields(Records)]
    if sorted(arrays) != sorted(names):
        raise ImageError(f"{path}: has arrays {sorted(arrays)}; expected {sorted(names)}")
    expected = {name: np.dtype(np.int64 if name == "number" else np.float32) for name in names}
    for name, dtype in expected.items():
        if arrays[name].dtype != dtype:
            raise ImageError(f"{path}: {name} is {arrays[name].dtype}; expected {dtype}")
    records = Records(**arrays)
    try:
        check(records, str(path))
    except ProtocolError as error:
        raise ImageError(str(error)) from None
    return records
