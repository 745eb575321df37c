"""The Cornell box as it was measured.

Cornell University Program of Computer Graphics, "Cornell Box Data", 1998
(www.graphics.cornell.edu/online/box/data.html).

The colours are the usual linear RGB approximations of the measured spectra.
"""

from __future__ import annotations

import numpy as np

from wdpm.scenes.model.scene import Camera, Mesh, Scene, diffuse
from wdpm.scenes.model.transforms import look_at

_Point = tuple[float, float, float]
_Quad = tuple[_Point, _Point, _Point, _Point]

LAMP_DROP = 0.5  # mm below the ceiling: the real box has a hole there, in which the lamp lies flush
RADIANCE = (17.0, 12.0, 4.0)
EXPOSURE = 1.5  # stops: the measured lamp leaves the room dim
FOV = 39.3077  # degrees: a 25 mm film behind a 35 mm lens

_WHITE, _RED, _GREEN, _LAMP = range(4)
_MATERIALS = (
    diffuse("white", (0.725, 0.71, 0.68), twosided=True),
    diffuse("red", (0.63, 0.065, 0.05), twosided=True),
    diffuse("green", (0.14, 0.45, 0.091), twosided=True),
    diffuse("lamp", (0.0, 0.0, 0.0), twosided=True),
)

# millimetres, counter-clockwise seen from inside the room or outside the blocks
_ROOM: dict[str, tuple[int, tuple[_Quad, ...]]] = {
    "floor": (_WHITE, (((552.8, 0, 0), (0, 0, 0), (0, 0, 559.2), (549.6, 0, 559.2)),)),
    "ceiling": (_WHITE, (((556, 548.8, 0), (556, 548.8, 559.2), (0, 548.8, 559.2), (0, 548.8, 0)),)),
    "back wall": (_WHITE, (((549.6, 0, 559.2), (0, 0, 559.2), (0, 548.8, 559.2), (556, 548.8, 559.2)),)),
    "right wall": (_GREEN, (((0, 0, 559.2), (0, 0, 0), (0, 548.8, 0), (0, 548.8, 559.2)),)),
    "left wall": (_RED, (((552.8, 0, 0), (549.6, 0, 559.2), (556, 548.8, 559.2), (556, 548.8, 0)),)),
    "short block": (
        _WHITE,
        (
            ((130, 165, 65), (82, 165, 225), (240, 165, 272), (290, 165, 114)),
            ((290, 0, 114), (290, 165, 114), (240, 165, 272), (240, 0, 272)),
            ((130, 0, 65), (130, 165, 65), (290, 165, 114), (290, 0, 114)),
            ((82, 0, 225), (82, 165, 225), (130, 165, 65), (130, 0, 65)),
            ((240, 0, 272), (240, 165, 272), (82, 165, 225), (82, 0, 225)),
        ),
    ),
    "tall block": (
        _WHITE,
        (
            ((423, 330, 247), (265, 330, 296), (314, 330, 456), (472, 330, 406)),
            ((423, 0, 247), (423, 330, 247), (472, 330, 406), (472, 0, 406)),
            ((472, 0, 406), (472, 330, 406), (314, 330, 456), (314, 0, 456)),
            ((314, 0, 456), (314, 330, 456), (265, 330, 296), (265, 0, 296)),
            ((265, 0, 296), (265, 330, 296), (423, 330, 247), (423, 0, 247)),
        ),
    ),
}
_LAMP_HEIGHT = 548.8 - LAMP_DROP
_LAMP_QUAD: _Quad = (
    (343, _LAMP_HEIGHT, 227),
    (343, _LAMP_HEIGHT, 332),
    (213, _LAMP_HEIGHT, 332),
    (213, _LAMP_HEIGHT, 227),
)


def cornell_box(size: tuple[int, int] | None = None) -> Scene:
    """The Cornell box: 30 triangles and a lamp of 2, seen by the camera of the measurement. Lengths in millimetres.

    Args:
        size: width and height of the image in pixels; 512x512 by default.
    """
    width, height = size or (512, 512)
    meshes = [_mesh(name, quads, material) for name, (material, quads) in _ROOM.items()]
    lamp = _mesh("lamp", (_LAMP_QUAD,), _LAMP, RADIANCE)
    to_world = look_at((278.0, 273.0, -800.0), (278.0, 273.0, -799.0), (0.0, 1.0, 0.0))
    camera = Camera(to_world, FOV, width, height, near_clip=1.0, far_clip=1e4)
    return Scene("cornell-box", (*meshes, lamp), _MATERIALS, (), camera, exposure=EXPOSURE)


def _mesh(name: str, quads: tuple[_Quad, ...], material: int, emission: _Point | None = None) -> Mesh:
    vertices = np.array(quads, dtype=np.float64).reshape(-1, 3)
    first = 4 * np.arange(len(quads))[:, None, None]
    faces = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    uvs = np.tile([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], (len(quads), 1))
    return Mesh(name, vertices, faces, None, uvs, material, emission)
