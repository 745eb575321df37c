"""What an OBJ file holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.meshes.mesh_data import MeshData

NO_MATERIAL: Final = ""

# neither surfaces nor how they look: names, smoothing groups, points, lines, free-form geometry, display attributes
# fmt: off
IGNORED: Final = frozenset((
    "g", "o", "s", "mg", "p", "l", "vp", "cstype", "deg", "bmat", "step", "curv", "curv2", "surf", "parm", "trim",
    "hole", "scrv", "sp", "end", "con", "bevel", "c_interp", "d_interp", "lod", "shadow_obj", "trace_obj", "ctech",
    "stech", "maplib", "usemap",
))
# fmt: on


@dataclass(frozen=True, eq=False)
class ObjFile:
    """What an OBJ file holds.

    Attributes:
        mesh: all its triangles.
        materials: names from `usemtl`, in order of first use; "" for faces before any.
        face_material: index into materials for every triangle, int32, shape [F].
        libraries: file names from `mtllib`, with the line they are in.
        warnings: what was not understood.
        partly_colored: whether there are colours behind the positions of some vertices alone, or words that are none;
            such colours are not kept.
    """

    mesh: MeshData
    materials: tuple[str, ...]
    face_material: NDArray[np.int32]
    libraries: tuple[tuple[str, int], ...]
    warnings: tuple[str, ...]
    partly_colored: bool = False


def unknown_keywords(name: str, found: dict[str, int]) -> tuple[str, ...]:
    """Warnings of keywords that nobody knows.

    Args:
        name: of the file.
        found: line of each.
    """
    return tuple(f'{name}:{line}: unknown keyword "{word[:40]}" ignored' for word, line in found.items())
