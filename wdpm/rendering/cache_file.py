"""Irradiance records in a file: those of one view, for others of the same scene.

A view that loads them makes none of its own; where none reaches, it traces gather rays. They are data like the scene:
the same file gives the same image, bit for bit, on any cluster (array_file).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from os import PathLike, fsdecode
from pathlib import Path
from typing import Any

import numpy as np

from wdpm.cluster.messages.checks import check
from wdpm.cluster.records import LARGEST, Records, moderate
from wdpm.cluster.render_settings import RenderSettings
from wdpm.images.files import check_place
from wdpm.images.image import Image
from wdpm.rendering.array_file import BrokenArraysError, read_arrays, write_arrays
from wdpm.scenes.errors import ImageError, ProtocolError, SettingsError

FORMAT = 3
"""Of the file; grows with every change that older or newer code would not understand."""


@dataclass(frozen=True)
class CacheFiles:
    """Where irradiance records are written to and read from; None for nowhere."""

    save: Path | None = None
    load: Path | None = None

    @classmethod
    def named(cls, save: str | PathLike[str] | None, load: str | PathLike[str] | None) -> CacheFiles:
        """Those of these names, as people give them."""
        return cls(path_named(save), path_named(load))


def path_named(given: str | PathLike[str] | None) -> Path | None:
    """A path as people give it; SettingsError for what is none."""
    if not isinstance(given, str | PathLike | None):
        raise SettingsError(f"{given!r} is no name of a file or folder")
    return None if given is None else Path(fsdecode(given))


NO_CACHE_FILES = CacheFiles()


class CacheNotWrittenError(ImageError):
    """A render is done, and its irradiance records cannot be written.

    Attributes:
        image: that was rendered.
    """

    def __init__(self, message: str, image: Image) -> None:
        super().__init__(message)
        self.image = image


def check_can_save(files: CacheFiles, *, in_journal: bool) -> None:
    """Find out whether records can be written, hours before they are there.

    Args:
        in_journal: whether passes are kept, to go on from. That has no records, which may be all that is left to do.

    Raises:
        ImageError: not where they are to go.
        SettingsError: passes are kept.
    """
    if files.save is None:
        return
    if in_journal:
        raise SettingsError(
            "--save-cache: passes that are kept have no irradiance records; leave --save-cache out, or --keep-passes "
            "and the journal of passes"
        )
    check_place(files.save)


def check_wanted(files: CacheFiles, settings: RenderSettings) -> None:
    """Raise SettingsError unless a render with these settings, which leave nothing open, has one set of records."""
    option = "--save-cache" if files.save is not None else "--load-cache"
    if files == NO_CACHE_FILES:
        return
    algorithm = settings.algorithm
    if not algorithm.shoots_photons:
        raise SettingsError(
            f"{option}: {algorithm.words} has no irradiance cache; leave {option} out, or render with --integrator "
            "photons"
        )
    if not settings.photons or "indirect" in settings.without:
        why = "--photons 0" if not settings.photons else "--without indirect"
        raise SettingsError(f"{option}: {why} leaves nothing for an irradiance cache; leave one of them out")
    if not algorithm.has_irradiance_cache(settings):
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
    write_arrays(path, {"format": FORMAT, "scene": scene}, vars(records))


def read_records(path: Path, scene: str) -> Records:
    """The records of a file.

    Raises:
        ImageError: there is no such file, it is broken, or it is of another scene.
    """
    try:
        header, arrays = read_arrays(path)
        of_format, of_scene = int(header["format"]), str(header["scene"])
    except FileNotFoundError:
        raise ImageError(f"{path}: no such file; write one by --save-cache") from None
    except BrokenArraysError as error:
        raise ImageError(f"{path}: is no file of irradiance records: {error}; write one by --save-cache") from None
    except (KeyError, TypeError, ValueError):
        raise ImageError(
            f"{path}: is no file of irradiance records, but of others; write one by --save-cache"
        ) from None
    if of_format != FORMAT:
        raise ImageError(f"{path}: is of format {of_format}, this wdpm has {FORMAT}; write it anew by --save-cache")
    if of_scene != scene:
        raise ImageError(
            f"{path}: its irradiance records are of another scene, or of other photons; only the camera, its samples "
            "and what changes no bit may differ; give --indirect cache for both, since a render that is free to choose "
            "takes as many photons as its camera and samples ask for"
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
    if not moderate(records):
        raise ImageError(f"{path}: irradiance records with numbers above {LARGEST:g}")
    return records
