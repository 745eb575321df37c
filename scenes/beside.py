"""Where the names of files in a scene's file are looked up: beside it.

A scene's file may be a link. Mitsuba, pbrt and Blender look beside the link alone; here what is not there is looked up
beside the file that the link stands for.
"""

from __future__ import annotations

import os
from pathlib import Path


def folders_beside(file: Path) -> tuple[Path, ...]:
    """The folder of a file and, if it is a link, then that of what it stands for."""
    if not file.is_symlink():
        return (file.parent,)
    return file.parent, Path(os.path.realpath(file)).parent


def file_beside(file: Path, name: str) -> Path:
    """The file that another names; where there is none, the path at which it is missed first."""
    paths = [folder / name for folder in folders_beside(file)]
    return next((path for path in paths if path.is_file()), paths[0])
