"""Whether something is a mesh of trimesh, told without importing trimesh; `from_trimesh` reads it then."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    import trimesh

Meshes: TypeAlias = "trimesh.Trimesh | trimesh.Scene | Sequence[trimesh.Trimesh]"
"""One mesh, several, or a scene with its transforms, camera and lights."""


def is_of_trimesh(source: object) -> bool:
    """Whether `read_trimesh` takes it: meshes, a scene, or a list or tuple of meshes alone."""
    trimesh = sys.modules.get("trimesh")  # whoever has a mesh has imported it; no command waits for it
    if trimesh is None:
        return False
    if isinstance(source, list | tuple):
        return bool(source) and all(isinstance(each, trimesh.Trimesh) for each in source)
    return isinstance(source, trimesh.Trimesh | trimesh.Scene)
