"""A procedural hall, for people without models and for tests of scale: two floors of arcades around a skylit court.

One number, of triangles, sets how finely everything is built; the hall itself stays the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wdpm.scenes.builtin import atrium_parts as parts
from wdpm.scenes.errors import SceneError
from wdpm.scenes.meshes.mesh_data import MeshData
from wdpm.scenes.model.scene import Camera, Mesh, Scene, diffuse
from wdpm.scenes.model.textures import RGB, Bitmap, Interpolation
from wdpm.scenes.model.transforms import look_at

MIN_TRIANGLES, MAX_TRIANGLES, DEFAULT_TRIANGLES = 10_000, 10_000_000, 100_000

EXPOSURE = -0.3  # stops: its court is in the sun

# the plan, in metres: a court of 7 x 3 bays with an aisle one bay deep on all sides
BAY = 4.0
BAYS_X, BAYS_Z = 7, 3
HALF_X, HALF_Z = BAY * BAYS_X / 2.0, BAY * BAYS_Z / 2.0
OUTER_X, OUTER_Z = HALF_X + BAY, HALF_Z + BAY
WALL = 0.8  # thickness of the arcades
ARCH_RADIUS = 1.6
FLOORS = ((0.0, 3.6, 6.0), (6.0, 2.8, 5.0))  # each floor's level, its arches' springing above it, its height
ATTIC, SKYLIGHT = 11.0, 13.0
VAULT_RISE = 1.9
RAIL_HEIGHT = 0.95
RADIANCE: RGB = (3.6, 3.5, 3.25)

_MATERIALS: dict[str, RGB] = {
    "stone": (0.70, 0.64, 0.54),
    "plaster": (0.78, 0.74, 0.66),
    "vault": (0.74, 0.72, 0.70),
    "marble": (0.80, 0.78, 0.75),
    "terracotta": (0.62, 0.30, 0.18),
    "ochre": (0.70, 0.50, 0.22),
    "red": (0.62, 0.07, 0.06),
    "green": (0.10, 0.40, 0.14),
    "blue": (0.09, 0.17, 0.48),
    "lamp": (0.0, 0.0, 0.0),
}


# blocks, jambs of the arches, rails, and the shell: what no fineness changes
_FIXED = 40 * 24 + 40 * 8 + 20 * 24 + 122


@dataclass(frozen=True)
class _Fineness:
    """How finely the pieces are built; the numbers of triangles grow with the square of `level`."""

    column_around: int
    column_rows: int
    arch_segments: int
    roll_around: int
    vault_cells: int
    balusters: int
    baluster_around: int
    baluster_rows: int
    cloth_cells: int
    cornice_rows: int

    @classmethod
    def at(cls, level: float) -> _Fineness:
        def scaled(at_one: float, least: int, most: int = 1 << 20) -> int:
            return min(max(round(at_one * level), least), most)

        return cls(
            column_around=scaled(14, 6),
            column_rows=scaled(18, 4),
            arch_segments=scaled(16, 4),
            roll_around=scaled(6, 3),
            vault_cells=2 * scaled(5, 2),  # even, so that the groins run along edges
            balusters=scaled(6, 3, 10),
            baluster_around=scaled(7, 4),
            baluster_rows=scaled(11, 3),
            cloth_cells=scaled(16, 4),
            cornice_rows=scaled(10, 4, 400),
        )

    @property
    def triangle_count(self) -> int:
        """What `_pieces` makes of it; so that a size can be found without building any."""
        bays, aisles = len(_bays()), len(_aisle_places())
        columns = 2 * len(_column_places()) * 2 * self.column_around * self.column_rows
        arches = 2 * bays * self.arch_segments * (2 * self.roll_around + 6)
        vaults = 2 * aisles * 2 * self.vault_cells**2
        balusters = bays * self.balusters * 2 * self.baluster_around * self.baluster_rows
        fountain = 2 * (2 * self.column_around) * (3 * self.column_rows)
        cloths = (12 + 3) * 2 * self.cloth_cells**2
        return columns + arches + vaults + balusters + fountain + cloths + 2 * 8 * self.cornice_rows + _FIXED


@dataclass(frozen=True, eq=False)
class _Piece:
    """A mesh and the places of its copies: offsets and turns around y."""

    name: str
    material: str
    mesh: MeshData
    offsets: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),)
    degrees: tuple[float, ...] = (0.0,)

    @property
    def triangle_count(self) -> int:
        return len(self.mesh.faces) * len(self.offsets)


def atrium(triangles: int = DEFAULT_TRIANGLES, size: tuple[int, int] | None = None) -> Scene:
    """A two-storeyed arcaded court, 36 x 20 x 13 metres, lit by the sky through its open roof.

    Args:
        triangles: how many it is made of, 10,000 to 10,000,000; met within 5 %.
        size: width and height of the image in pixels; 512x512 by default.

    Raises:
        SceneError: a number of triangles that is out of range.
    """
    if not MIN_TRIANGLES <= triangles <= MAX_TRIANGLES:
        raise SceneError(f"atrium: {triangles} triangles; expected {MIN_TRIANGLES} to {MAX_TRIANGLES}")
    pieces = _pieces(_finest(triangles))
    left = triangles - sum(piece.triangle_count for piece in pieces)
    pieces.append(_floor(left))
    numbers = {name: number for number, name in enumerate([*_MATERIALS, "tiles"])}
    meshes = [_placed(piece, numbers[piece.material]) for piece in pieces]
    materials = [diffuse(name, colour, twosided=True) for name, colour in _MATERIALS.items()]
    materials.append(diffuse("tiles", _tiles(), twosided=True))
    width, height = size or (512, 512)
    to_world = look_at((-13.0, 2.1, -2.6), (2.0, 4.3, 1.2), (0.0, 1.0, 0.0))
    camera = Camera(to_world, 80.0, width, height, near_clip=0.05, far_clip=1e3)
    return Scene("atrium", tuple(meshes), tuple(materials), (), camera, exposure=EXPOSURE)


def _finest(triangles: int) -> _Fineness:
    """The finest build that leaves triangles for the floor, by bisection."""
    low, high = 0.0, 64.0
    for _ in range(24):  # to 4e-6, finer than any step of the integers in it
        middle = (low + high) / 2.0
        enough = _Fineness.at(middle).triangle_count <= triangles - 2
        low, high = (middle, high) if enough else (low, middle)
    return _Fineness.at(low)


def _placed(piece: _Piece, material: int) -> Mesh:
    mesh = parts.copied(piece.mesh, piece.offsets, piece.degrees)
    emission = RADIANCE if piece.name == "skylight" else None
    return Mesh(piece.name, mesh.vertices, mesh.faces, mesh.normals, mesh.uvs, material, emission)


def _bays() -> list[tuple[float, float, float]]:
    """Middle of each arcade bay (x, z) and the turn that makes +z point into the court."""
    along_x = [BAY * (i - (BAYS_X - 1) / 2.0) for i in range(BAYS_X)]
    along_z = [BAY * (i - (BAYS_Z - 1) / 2.0) for i in range(BAYS_Z)]
    return [
        *((x, -HALF_Z, 0.0) for x in along_x),
        *((x, HALF_Z, 180.0) for x in along_x),
        *((-HALF_X, z, 90.0) for z in along_z),
        *((HALF_X, z, -90.0) for z in along_z),
    ]


def _column_places() -> list[tuple[float, float]]:
    along_x = [BAY * i - HALF_X for i in range(BAYS_X + 1)]
    along_z = [BAY * i - HALF_Z for i in range(1, BAYS_Z)]
    return [(x, z) for z in (-HALF_Z, HALF_Z) for x in along_x] + [(x, z) for x in (-HALF_X, HALF_X) for z in along_z]


def _aisle_places() -> list[tuple[float, float]]:
    """Middles of the vaulted squares around the court."""
    xs = [BAY * (i - (BAYS_X + 1) / 2.0) for i in range(BAYS_X + 2)]
    zs = [BAY * (i - (BAYS_Z + 1) / 2.0) for i in range(BAYS_Z + 2)]
    return [(x, z) for x in xs for z in zs if abs(x) > HALF_X or abs(z) > HALF_Z]


def _pieces(fine: _Fineness) -> list[_Piece]:
    """Everything but the floor of the court."""
    pieces = [*_shell(), *_furnishing(fine)]
    for number, (level, spring, height) in enumerate(FLOORS, start=1):
        pieces += _arcade(fine, number, level, spring, height)
    rows = fine.cornice_rows
    rims = ((0.0, FLOORS[1][0] - 0.5, 0.0), (0.0, ATTIC, 0.0))
    pieces.append(
        _Piece("cornices", "stone", parts.cornice(HALF_X - WALL / 2, HALF_Z - WALL / 2, rows), rims, (0.0, 0.0))
    )
    return pieces + _balustrades(fine)


def _arcade(fine: _Fineness, number: int, level: float, spring: float, height: float) -> list[_Piece]:
    """Columns, arches and vaults of one floor."""
    places = tuple((x, level, z) for x, z in _column_places())
    upright = (0.0,) * len(places)
    foot, cap = 0.12, 0.18
    column = parts.turned(parts.COLUMN, spring - foot - cap, fine.column_around, fine.column_rows)
    blocks = [
        parts.box((-0.6, 0.0, -0.6), (0.6, foot, 0.6)),
        parts.box((-0.56, spring - cap, -0.56), (0.56, spring, 0.56)),
    ]
    walls, mouldings = parts.arch(ARCH_RADIUS, WALL, BAY, spring, height, fine.arch_segments, fine.roll_around)
    bays = tuple((x, level, z) for x, z, _ in _bays())
    turns = tuple(turn for _, _, turn in _bays())
    vault = parts.groin_vault(BAY / 2.0, spring, VAULT_RISE, fine.vault_cells)
    aisles = tuple((x, level, z) for x, z in _aisle_places())
    return [
        _Piece(f"columns {number}", "marble", column, tuple((x, y + foot, z) for x, y, z in places), upright),
        _Piece(f"blocks {number}", "stone", parts.merged(blocks), places, upright),
        _Piece(f"arches {number}", "plaster", walls, bays, turns),
        _Piece(f"mouldings {number}", "stone", mouldings, bays, turns),
        _Piece(f"vaults {number}", "vault", vault, aisles, (0.0,) * len(aisles)),
    ]


def _balustrades(fine: _Fineness) -> list[_Piece]:
    """Rails between the columns of the upper floor."""
    level = FLOORS[1][0]
    bays = tuple((x, level, z) for x, z, _ in _bays())
    turns = tuple(turn for _, _, turn in _bays())
    half = BAY / 2.0 - 0.5
    rails = parts.merged(
        [
            parts.box((-half, 0.0, -0.16), (half, 0.12, 0.16)),
            parts.box((-half, RAIL_HEIGHT - 0.12, -0.18), (half, RAIL_HEIGHT, 0.18)),
        ]
    )
    baluster = parts.turned(parts.BALUSTER, RAIL_HEIGHT - 0.24, fine.baluster_around, fine.baluster_rows)
    along = (np.arange(fine.balusters) + 0.5) / fine.balusters * 2.0 * half - half
    row = parts.copied(baluster, np.stack([along, np.full_like(along, 0.12), np.zeros_like(along)], axis=1))
    return [
        _Piece("rails", "stone", rails, bays, turns),
        _Piece("balusters", "marble", row, bays, turns),
    ]


def _furnishing(fine: _Fineness) -> list[_Piece]:
    """Cloths over the rails, sails across the court and a fountain."""
    fountain = parts.turned(parts.FOUNTAIN, 2.6, 2 * fine.column_around, 3 * fine.column_rows)
    pieces = [_Piece("fountain", "marble", fountain, ((2.0, 0.0, 0.0),))]
    cloth = parts.draped(2.3, 2.6, fine.cloth_cells, 3.5, 0.11)
    front = HALF_Z - WALL / 2.0 - 0.42  # clear of the cornice
    for name, columns in (("red", (-2, 1)), ("green", (0, 3)), ("blue", (-1, 2))):
        places = [(BAY * i, FLOORS[1][0] + 0.55, side * front) for i in columns for side in (-1.0, 1.0)]
        turns = [0.0 if z < 0 else 180.0 for _, _, z in places]
        pieces.append(_Piece(f"{name} cloths", name, cloth, tuple(places), tuple(turns)))
    sail = parts.sail(2.0 * HALF_Z - WALL, 1.8, 1.2, fine.cloth_cells)
    for name, x in (("red", -6.0), ("ochre", 2.0), ("blue", 10.0)):
        pieces.append(_Piece(f"{name} sail", name, sail, ((x, ATTIC - 0.7, 0.0),)))
    return pieces


def _shell() -> list[_Piece]:
    """Outer walls, the upper floor, the attic, the skylight and its beams: a few large rectangles."""
    x, z = OUTER_X, OUTER_Z
    walls = {
        "terracotta": [_upright((-x, -z), (x, -z), 0.0, ATTIC)],
        "ochre": [_upright((x, z), (-x, z), 0.0, ATTIC)],
        "red": [_upright((-x, z), (-x, -z), 0.0, ATTIC)],
        "green": [_upright((x, -z), (x, z), 0.0, ATTIC)],
    }
    pieces = [_Piece(f"{name} wall", name, parts.merged(quads)) for name, quads in walls.items()]
    level = FLOORS[1][0]
    strips = [
        _level((-x, -z), (x, -HALF_Z), level),
        _level((-x, HALF_Z), (x, z), level),
        _level((-x, -HALF_Z), (-HALF_X, HALF_Z), level),
        _level((HALF_X, -HALF_Z), (x, HALF_Z), level),
    ]
    pieces.append(_Piece("gallery floors", "stone", parts.merged(strips)))
    cx, cz = HALF_X - WALL / 2.0, HALF_Z - WALL / 2.0
    ring = ((-cx, -cz), (cx, -cz), (cx, cz), (-cx, cz))
    attic = [_upright(ring[i], ring[(i + 1) % 4], ATTIC, SKYLIGHT) for i in range(4)]
    pieces.append(_Piece("attic", "plaster", parts.merged(attic)))
    skylight = parts.quad([(-cx, SKYLIGHT, -cz), (cx, SKYLIGHT, -cz), (cx, SKYLIGHT, cz), (-cx, SKYLIGHT, cz)])
    pieces.append(_Piece("skylight", "lamp", skylight))
    beams = [parts.box((-cx, SKYLIGHT - 0.55, at - 0.15), (cx, SKYLIGHT - 0.1, at + 0.15)) for at in (-2.0, 2.0)]
    across = [-HALF_X + BAY * i for i in range(1, BAYS_X)]
    beams += [parts.box((at - 0.15, SKYLIGHT - 0.5, -cz), (at + 0.15, SKYLIGHT - 0.12, cz)) for at in across]
    pieces.append(_Piece("beams", "stone", parts.merged(beams)))
    return pieces


def _upright(start: tuple[float, float], end: tuple[float, float], bottom: float, top: float) -> MeshData:
    """A wall over a line from start to end, both (x, z) in the plan."""
    (x0, z0), (x1, z1) = start, end
    return parts.quad([(x0, bottom, z0), (x1, bottom, z1), (x1, top, z1), (x0, top, z0)])


def _level(low: tuple[float, float], high: tuple[float, float], y: float) -> MeshData:
    """A rectangle in the plan that faces up."""
    (x0, z0), (x1, z1) = low, high
    return parts.quad([(x0, y, z0), (x0, y, z1), (x1, y, z1), (x1, y, z0)])


def _floor(triangles: int) -> _Piece:
    """The ground floor, of about that many triangles: it takes up what the rounding of all others leaves."""
    cells = max(triangles // 2, 1)
    cells_z = max(round((cells * OUTER_Z / OUTER_X) ** 0.5), 1)
    mesh = parts.floor(OUTER_X, OUTER_Z, max(cells // cells_z, 1), cells_z, tile=2.0)
    return _Piece("floor", "tiles", mesh)


def _tiles() -> Bitmap:
    """Light and dark marble in a chequered pattern with narrow joints; one repeat is two by two tiles."""
    light, dark, joint = np.array([[0.72, 0.68, 0.60], [0.36, 0.24, 0.18], [0.30, 0.28, 0.26]], dtype=np.float32)
    texels = np.arange(64)
    black = (texels[:, None] // 32 + texels[None, :] // 32) % 2 == 1
    pixels = np.where(black[:, :, None], dark, light)
    edge = texels % 32 == 0
    pixels[edge[:, None] | edge[None, :]] = joint
    return Bitmap("tiles", pixels, interpolation=Interpolation.NEAREST)
