"""The folder of a sweep: an image and a record of every render, so that one that was interrupted can go on.

Files are written one by one, whole or not at all, and named by what was rendered; the record comes last. So what is
there is complete, whenever the sweep was interrupted.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from enum import Enum
from pathlib import Path
from typing import Any

from wdpm.accuracy.points import Point
from wdpm.cluster.render_settings import RenderSettings
from wdpm.images.files import write_bytes
from wdpm.images.image import Image, load
from wdpm.scenes.errors import ImageError

RENDERS = "renders"
"""The folder of images and records."""


@dataclass(frozen=True)
class Record:
    """One render.

    Attributes:
        seconds: wall-clock time but for loading the scene and compiling kernels.
        cpu_seconds: of all cores together; with slaves, this process's own and what these spent in kernels.
        phases: wall-clock seconds by phase.
        digest: of the image, all its layers (Image.digest).
        stored: photons in all maps.
        ghosts: copies of photons in overlap bands.
        bytes: sent by all slaves.
        left_band: gathers that may have missed a photon beyond the band.
    """

    seconds: float
    cpu_seconds: float
    phases: dict[str, float]
    digest: str
    stored: int
    ghosts: int
    bytes: int
    left_band: int


class Store:
    """Renders of one scene, on one machine, by one version of the code.

    Args:
        folder: exists.
        identity: what all renders have in common and their images or times depend on; others' are not found.
    """

    def __init__(self, folder: Path, identity: Mapping[str, Any]) -> None:
        self.folder = folder
        self._identity = dict(identity)

    def image_path(self, point: Point, seed: int) -> Path:
        """Where the image of a render is, or will be."""
        return self._path(point, seed, ".exr")

    def find(self, point: Point, seed: int) -> Record | None:
        """The record of a render, if it was done. Raises ImageError if it cannot be read."""
        path = self._path(point, seed, ".json")
        if not path.is_file() or not self.image_path(point, seed).is_file():
            return None
        try:
            data = json.loads(path.read_text())
            return Record(**{field.name: data[field.name] for field in fields(Record)})
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ImageError(
                f"{path}: is no record of a render ({error}); delete it to have it rendered again"
            ) from None

    def keep(self, point: Point, seed: int, image: Image, record: Record) -> None:
        """Write a render. Raises ImageError."""
        beauty = Image({"beauty": image.pixels}, image.metadata)
        beauty.save(self.image_path(point, seed))
        data = {"settings": plain_settings(point.settings, seed), "slaves": point.slaves, **asdict(record)}
        write_bytes(json.dumps(data, indent=2).encode(), self._path(point, seed, ".json"))

    def image(self, point: Point, seed: int) -> Image:
        """The image of a render that was kept. Raises ImageError if it is broken."""
        try:
            return load(self.image_path(point, seed))
        except ImageError as error:
            raise ImageError(f"{error}; delete it and run again to have it rendered again") from None

    def digest(self, *parts: Any) -> str:
        """Names something that belongs to this scene, machine and code."""
        text = json.dumps([self._identity, *parts], sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()

    def _path(self, point: Point, seed: int, extension: str) -> Path:
        settings = plain_settings(point.settings, seed)
        name = self.digest(settings, point.slaves)[:12]
        few = f"p{point.settings.photons}-k{point.settings.k}-spp{point.settings.spp}-seed{seed}"
        return self.folder / RENDERS / f"{few}-{name}{extension}"


def make_folder(folder: Path) -> None:
    """Make the folder of a sweep, if it is not there. Raises ImageError."""
    try:
        (folder / RENDERS).mkdir(parents=True, exist_ok=True)
        probe = folder / RENDERS / ".probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        reason = error.strerror.lower() if error.strerror else str(error)
        raise ImageError(f"{folder}: results cannot be written there: {reason}") from None


def plain_settings(settings: RenderSettings, seed: int) -> dict[str, Any]:
    """Settings as JSON has them, with this seed."""
    values = asdict(settings) | {"seed": seed}
    return {name: value.value if isinstance(value, Enum) else value for name, value in values.items()}
