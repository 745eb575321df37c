"""Section 2: triangles that real meshes have, and should not."""

from __future__ import annotations

import numpy as np
import warp as wp
from case import Run, hard_case
from partitions import planes, with_tree
from placing import scaled
from rooms import Array, ball, box, glowing_box, lit_room, quad, scene, triangles, view

from wdpm.cluster.render_settings import RenderSettings
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes.errors import SceneError
from wdpm.scenes.model.bsdfs import WHITE, Dielectric
from wdpm.scenes.model.lights import Environment
from wdpm.scenes.model.scene import Material, Mesh, diffuse

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

RED = diffuse("red", (0.8, 0.1, 0.1), twosided=True)
SKY = Environment("sky", np.ones((1, 1, 3), np.float32))


NO_BIT = "none: what is dropped is numbered by nobody, so no bit may change"
BLACK = "none: not a single ray may get through"


def _same_as_without(run: Run, added: list[Mesh], what: str) -> None:
    """What has no surface of its own changes no bit."""
    photons = 5_000 if run.full else 1_000
    plain = run.render(lit_room(16 if run.full else 8), photons=photons, spp=2, cells=1)
    image = run.render(lit_room(16 if run.full else 8, added), photons=photons, spp=2)
    run.demand(f"the bits of the room without {what}", image.digest() == plain.digest())


@hard_case(
    "triangles of zero area",
    section=2,
    shows="points and lines as triangles",
    expected="the room without them",
    tolerance=NO_BIT,
)
def zero_area(run: Run) -> None:
    point, line = np.full((3, 3), 0.25), np.array([[0, 0, 0], [0.25, 0.25, 0.25], [0.5, 0.5, 0.5]])
    _same_as_without(run, [triangles([point, line, line[[0, 0, 2]]])], "triangles of zero area")


@hard_case(
    "vertices that are not finite",
    section=2,
    shows="NaN, inf and -inf",
    expected="the room without them",
    tolerance=NO_BIT,
)
def not_finite(run: Run) -> None:
    bad = np.tile(np.array([[0.0, 0, 0], [0.5, 0, 0], [0, 0.5, 0]]), (3, 1, 1))
    bad[0, 0, 0], bad[1, 1, 1], bad[2, 2, 2] = np.nan, np.inf, -np.inf
    _same_as_without(run, [triangles(bad)], "vertices that are not finite")


@hard_case(
    "denormal vertices", section=2, shows="a triangle of 1e-40", expected="the room without it", tolerance=NO_BIT
)
def denormal(run: Run) -> None:
    """Three corners within 1e-40 of each other are one place in float32."""
    _same_as_without(run, [triangles(np.eye(3)[None] * 1e-40)], "triangles of 1e-40")


@hard_case(
    "instanced duplicates",
    section=2,
    shows="each wall ten times, turned",
    expected="the room with each once",
    tolerance=NO_BIT,
)
def duplicates(run: Run) -> None:
    """Every wall nine times more, in another material, some with their corners turned around."""
    walls = lit_room().meshes[0]
    copies = [Mesh(f"copy {i}", walls.vertices, np.roll(walls.faces, i, axis=1), None, walls.uvs, 0) for i in range(9)]
    _same_as_without(run, copies, "nine copies of its walls")


@hard_case(
    "an index out of range",
    section=2,
    shows="a face names vertex 3 of 3",
    expected="an error that names the mesh",
    tolerance="none",
)
def index_out_of_range(run: Run) -> None:
    mesh = Mesh("broken", np.eye(3), np.array([[0, 1, 3]]), None, None, 0)
    try:
        render_in_process(lit_room(8, [mesh]), RenderSettings(photons=0, spp=1), workers=1)
    except SceneError as error:
        run.demand("the error names the mesh", "broken" in str(error), str(error), 'a message with "broken" in it')
    else:
        run.demand("an error", False)


@hard_case(
    "needles",
    section=2,
    shows="walls with strips of 1 : 2e7",
    expected="a closed furnace: Le / (1 - albedo) = 2",
    tolerance="1.5 % (small: 3 %): noise of photons, and of direct light near edges",
)
def needles(run: Run) -> None:
    """A glowing box in which every wall has a strip 1e-7 wide along its middle."""
    strips = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            across, along = (axis + 1) % 3, (axis + 2) % 3
            for begin, end in ((-1.0, -5e-8), (-5e-8, 5e-8), (5e-8, 1.0)):
                corner, u, v = np.zeros(3), np.zeros(3), np.zeros(3)
                corner[axis], corner[across], corner[along] = side, begin, -1.0
                u[across], v[along] = end - begin, 2.0
                strips.append(quad(corner, *((v, u) if side > 0 else (u, v)), emission=(1.0, 1.0, 1.0)))
    what = scene(strips, glowing_box().camera, [diffuse("wall", (0.5, 0.5, 0.5))])
    image = run.render(what, photons=40_000 if run.full else 5_000, spp=256 if run.full else 32, light_samples=8)
    run.check_share("radiance", image.pixels.mean(axis=(0, 1)), 2.0, 0.015 if run.full else 0.03)


@hard_case(
    "coplanar walls of two materials",
    section=2,
    shows="which of two surfaces in one place is seen",
    expected="the same everywhere: whatever the partition (symmetry)",
    tolerance="none: every bit",
)
def coplanar_walls(run: Run) -> None:
    """Two walls in one plane, of other outline, other diagonals and other colour."""
    front = quad((-0.8, -0.6, 0.5), (0.0, 1.3, 0.0), (1.5, 0.1, 0.0), 1, name="red")
    back = quad((-0.7, -0.7, 0.5), (0.1, 1.2, 0.0), (1.6, 0.0, 0.0), 0, name="grey")
    what = lit_room(24 if run.full else 10, [front, back], [RED])
    chosen = RenderSettings(photons=1_000, spp=2, all_effects=True)
    reference = run.render(what, settings=chosen, cells=8)
    for axis in range(3):
        with with_tree(*planes(what, [(axis, 0.05), (2, 0.5)])):
            image = render_in_process(what, chosen, workers=2, cells=4)
        run.demand(f"the same bits, split across axis {axis}", image.digest() == reference.digest())
    albedo = reference.layers["albedo"]
    of_one = (np.abs(albedo[..., 0] - albedo[..., 1]) < 1e-6) | (albedo[..., 0] > 0.5)
    run.demand("each pixel's colour is of its surfaces", bool(of_one.mean() > 0.5))


def _beyond(run: Run, meshes: list[Mesh], radius: float | None, most: float = 0.0) -> None:
    """A lamp in one room, the camera in the next one."""
    lamp = quad((-0.9, 0.98, -0.3), (0.5, 0, 0), (0, 0, 0.6), emission=(9.0, 9.0, 9.0), name="lamp")
    camera = view((0.9, 0.3, -0.8), (0.05, -0.6, 0.5), 70, 24 if run.full else 10)
    photons = 20_000 if run.full else 3_000
    chosen = RenderSettings(photons=photons, spp=2, radius=radius, all_effects=True)
    image = run.render(scene([*meshes, lamp], camera), settings=chosen)
    run.check("brightest pixel beyond the wall", image.pixels.max(), 0, most)
    run.demand("photons are there", image.metadata["report"]["photons"]["stored"] > photons / 2)


def _two_rooms(gap: float) -> list[Mesh]:
    """Rooms back to back, whose other walls are in no plane: the second is larger and higher."""
    first = box((0.5, 1.0, 1.0), (-0.5, 0, 0), inside=True, name="lit room")
    return [first, box((0.5, 1.6, 1.6), (0.5 + gap, 0, 0), inside=True, name="dark room")]


@hard_case(
    "walls thinner than the gather radius",
    section=2,
    shows="two rooms back to back, 1e-4 apart and not at all, gathers of 0.3",
    expected="the dark side is black",
    tolerance=BLACK,
)
def thin_walls(run: Run) -> None:
    for gap in (1e-4, 0.0):
        _beyond(run, _two_rooms(gap), 0.3)


@hard_case(
    "a wall thinner than an offset",
    section=2,
    shows="two faces 1e-9 apart, the same floats",
    expected="the dark side is black",
    tolerance=BLACK,
)
def wall_thinner_than_an_offset(run: Run) -> None:
    _beyond(run, _two_rooms(1e-9), None)


@hard_case(
    "one floor on both sides of a thin wall",
    section=2,
    shows="a wall of 2e-4 on a floor, gathers of 0.3",
    expected="the dark side is black",
    tolerance=BLACK,
    limit="a gather on the floor reaches below the wall, where the floor goes on with the same normal (bias of "
    "density estimation, no further than the gather radius, and gone with it: --passes shrinks it, --integrator "
    "path has none). It would take a ray to each photon of a gather that any triangle above its plane comes "
    "near, and cells that hold all triangles within the band, not photons alone",
)
def floor_below_a_wall(run: Run) -> None:
    """One floor runs on below the wall, and its photons next to the wall count on both sides of it."""
    _beyond(run, [box(inside=True, name="room"), box((1e-4, 1.0, 1.0), name="wall")], 0.3)


@hard_case(
    "a slit",
    section=2,
    shows="a lamp seen through a slit 0.01 wide",
    expected="radiance by quadrature of the form factor",
    tolerance="2 % (small: 6 %): one in ten shadow rays gets through, 3 sigma of 260,000 (16,000) of them",
)
def slit(run: Run) -> None:
    """A plate with a slit 0.01 wide under a lamp: what comes through it to the floor below its middle."""
    half, height, radiance = 0.005, 0.5, 10.0
    plate = [
        quad((-2.0, height, -2.0), (0, 0, 4.0), (2.0 - half, 0, 0), name="plate"),
        quad((half, height, -2.0), (0, 0, 4.0), (2.0 - half, 0, 0), name="plate"),
    ]
    lamp = quad((-0.05, height + 0.01, -0.5), (0.1, 0, 0), (0, 0, 1.0), emission=(radiance,) * 3, name="lamp")
    floor = quad((-2.0, 0.0, -2.0), (0, 0, 4.0), (4.0, 0, 0), name="floor")
    camera = view((0.0, 0.3, -0.0005), (0.0, 0.0, 0.0), 0.05, 8, (0, 0, 1))
    what = scene([*plate, lamp, floor], camera)
    samples = 16
    spp = 256 if run.full else 16
    image = run.render(what, photons=0, spp=spp, light_samples=samples)
    # Through the slit the floor sees lamp alone. Quadrature of cos² / d² over the slit as seen from the pixel's middle.
    z = (np.arange(4000) + 0.5) / 4000 * 1.0 - 0.5
    x = ((np.arange(200) + 0.5) / 200 * 2 - 1) * half
    gap = np.stack(np.meshgrid(x, z, indexing="ij"), axis=-1)
    above = (height + 0.01) / height
    seen = (np.abs(gap[..., 1] * above) <= 0.5) & (np.abs(gap[..., 0] * above) <= 0.05)
    d2 = gap[..., 0] ** 2 + gap[..., 1] ** 2 + height**2
    factor = float((seen * height**2 / d2**2).mean() * 2 * half * 1.0) / np.pi
    run.check_share("radiance below the slit", image.pixels.mean(), 0.5 * radiance * factor, 0.02 if run.full else 0.06)


@hard_case(
    "a lamp 1e-5 above a floor",
    section=2,
    shows="distances whose squares are 1e-10",
    expected="all light stays between the two, but for the gap's share of some 2e-4 (form factor, albedo 1/2)",
    tolerance="1.5e-3: 3 sigma of one path in 2,000 that leaves",
)
def lamp_close_to_a_floor(run: Run) -> None:
    """All light of a lamp 1e-5 above a floor stays between the two, but what leaves through the gap around them."""
    lamp = quad((-0.1, 1e-5, -0.1), (0.2, 0, 0), (0, 0, 0.2), emission=(5.0, 5.0, 5.0), name="lamp")
    floor = quad((-1.0, 0.0, -1.0), (0, 0, 2.0), (2.0, 0, 0), name="floor")
    what = scene([lamp, floor], view((0.4, 0.3, -0.9), (0.0, 0.0, 0.0), 50, 16))
    image = run.render(what, photons=50_000 if run.full else 2_000, spp=16 if run.full else 4)
    energy = image.metadata["report"]["energy"]
    run.check_share("power emitted", energy["emitted"], np.pi * 5.0 * 0.04, 1e-4)
    run.check("share that leaves through the gap", energy["escaped"] / energy["emitted"], 2e-4, 1.5e-3)


@hard_case(
    "nested and touching glass",
    section=2,
    shows="glass in water, a bubble in it, balls that touch",
    expected="radiance 1: a furnace",
    tolerance="0.5 % (small: 1 %): paths between the two normals of smooth balls end, 1e-3 of them; noise",
)
def nested_glass(run: Run) -> None:
    """Glass in water in air, a bubble in it, and two balls that touch, under a sky of 1: none can be seen."""
    materials = [
        Material("water", Dielectric(1.33)),
        Material("glass in water", Dielectric(1.5 / 1.33)),
        Material("bubble in glass", Dielectric(1.0 / 1.5)),
        Material("glass", Dielectric(1.5)),
    ]
    nested = [ball(1.0, (0, 0, 0), 0, 64), ball(0.8, (0.05, 0, 0), 1, 64), ball(0.4, (0.1, 0.1, 0), 2, 64)]
    touching = [ball(0.5, (-1.5, 0, 0), 3, 64), ball(0.5, (1.5, 0, 0), 3, 64)]
    camera = view((0.3, 0.4, -6.0), (0, 0, 0), 34, 24 if run.full else 10)
    what = scene([*nested, *touching], camera, materials, [SKY])
    image = run.render(what, photons=0, caustic_photons=0, spp=128 if run.full else 16)
    run.check("mean radiance", image.pixels.mean(), 1.0, 5e-3 if run.full else 1e-2)


@hard_case(
    "glass faces in one plane",
    section=2,
    shows="two boxes that share a face",
    expected="radiance 1: a furnace",
    tolerance="0.5 % (small: 1 %): noise of Russian roulette",
    limit="of two faces in one plane a ray meets the first and starts beyond both, so that it leaves glass that it "
    "has not entered: 0.973, as in Mitsuba 3.9.1; a gap of 1e-3 gives 1 in both. `wdpm check` names such faces "
    "(touching-solids) and what to do. It would take media with priorities (Schmidt & Budge 2002), which every ray "
    "and photon would have to carry from cell to cell",
)
def glass_faces_in_one_plane(run: Run) -> None:
    """Two glass boxes that share a face, under a sky of 1."""
    materials = [Material("glass", Dielectric(1.5))]
    boxes = [box((0.5, 0.5, 0.5), (-0.5, 0, 0)), box((0.5, 0.5, 0.5), (0.5, 0, 0))]
    camera = view((2.0, 2.5, -3.5), (0, 0, 0), 36, 24 if run.full else 10)
    image = run.render(
        scene(boxes, camera, materials, [SKY]), photons=0, caustic_photons=0, spp=128 if run.full else 32
    )
    run.check("mean radiance", image.pixels.mean(), 1.0, 5e-3 if run.full else 1e-2)


@hard_case(
    "inconsistent winding",
    section=2,
    shows="half of a ball's triangles face inwards",
    expected="radiance 1: a furnace",
    tolerance="0.5 %: noise",
)
def inconsistent_winding(run: Run) -> None:
    """A white two-sided ball whose triangles face in and out at random, under a sky of 1: it cannot be seen."""
    mesh = ball(1.0, around=32)
    faces = mesh.faces.copy()
    flipped = np.random.default_rng(2).random(len(faces)) < 0.5
    faces[flipped] = faces[flipped][:, ::-1]
    what = scene(
        [Mesh("ball", mesh.vertices, faces, None, None, 0)],
        view((0.3, 0.4, -4.0), (0, 0, 0), 34, 16 if run.full else 10),
        [diffuse("white", WHITE, twosided=True)],
        [SKY],
    )
    image = run.render(what, photons=0, spp=512 if run.full else 128)
    run.check("mean radiance", image.pixels.mean(), 1.0, 5e-3)


@hard_case(
    "open and non-manifold meshes",
    section=2,
    shows="five fins on one edge, a box without a lid",
    expected="black before a sky of 1: radiance 0 or 1",
    tolerance="none",
)
def open_and_non_manifold(run: Run) -> None:
    """Five black fins that share one edge, and a black box without a lid, before a sky of 1: 0 or 1, nothing else."""
    fins = [np.array([[0.0, -1, 0], [0.0, 1, 0], [np.cos(a), 0.3, np.sin(a)]]) for a in 2 * np.pi * np.arange(5) / 5]
    lidless = box((0.4, 0.4, 0.4), (1.5, 0, 0))
    meshes = [triangles(np.array(fins)), Mesh("open", lidless.vertices, lidless.faces[2:], None, None, 0)]
    camera = view((0.5, 0.8, -4.0), (0.5, 0, 0), 50, 24 if run.full else 12)
    what = scene(meshes, camera, [diffuse("black", (0.0, 0.0, 0.0), twosided=True)], [SKY])
    image = run.render(what, photons=100, spp=1)
    values = np.unique(image.pixels)
    run.demand("radiances", bool(np.isin(values, [0.0, 1.0]).all()), str(values[:4]), "0 or 1")
    run.demand("something and sky are seen", len(values) == 2)


def _crowd(count: int, size: float, at: Array) -> Mesh:
    rng = np.random.default_rng(5)
    return triangles(at + size * rng.normal(size=(count, 3, 3)), name="crowd")


@hard_case(
    "a crowd in one point",
    section=2,
    shows="a million (small: 20,000) triangles of 1e-6 in one place",
    expected="the room without them: they are smaller than a hundredth of a pixel",
    tolerance="direct light 1e-3, indirect 2 %: they take a millionth of the light, but photons are others",
)
def many_in_one_point(run: Run) -> None:
    """A crowd of triangles of 1e-6 in one place, seen as a speck: the room is lit as ever."""
    crowd = _crowd(1_000_000 if run.full else 20_000, 1e-6, np.array([0.25, -0.5, 0.25]))
    photons = 20_000 if run.full else 2_000
    plain = run.render(lit_room(), photons=photons, spp=4, cells=1)
    image = run.render(lit_room(8, [crowd]), photons=photons, spp=4)
    run.check_share("mean of direct light", image.layers["direct"].mean(), plain.layers["direct"].mean(), 1e-3)
    run.check_share("mean of indirect light", image.layers["indirect"].mean(), plain.layers["indirect"].mean(), 0.02)


@hard_case(
    "a million triangles in one place",
    section=2,
    shows="all corners are one point",
    expected="the room without",
    tolerance=NO_BIT,
)
def one_place_exactly(run: Run) -> None:
    """A crowd of triangles whose corners are all the same point."""
    count = 1_000_000 if run.full else 20_000
    _same_as_without(run, [triangles(np.broadcast_to([0.25, -0.5, 0.25], (count, 3, 3)))], "them")


@hard_case(
    "one large among many small",
    section=2,
    shows="a triangle as large as the scene among a million (small: 19,200)",
    expected="a closed furnace: 2",
    tolerance="1.5 % (small: 3 %): noise of photons, and of direct light near edges",
)
def one_large_among_small(run: Run) -> None:
    """A closed glowing box of many small triangles, and one triangle as large as the box in the middle of it."""
    side = 288 if run.full else 40  # 12 side²: 995,000 and 19,200
    cuts = np.linspace(-1.0, 1.0, side + 1)
    x, y = np.meshgrid(cuts, cuts, indexing="ij")
    soup = []
    for axis in range(3):
        for z in (-1.0, 1.0):
            grid = np.insert(np.stack([x, y], axis=-1), axis, z, axis=-1)
            a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
            parts = [np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]
            soup += [part.reshape(-1, 3, 3) for part in parts]
    corners = np.concatenate(soup)
    facing = np.einsum(
        "ta,ta->t", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), corners[:, 0]
    )
    corners[facing > 0] = corners[facing > 0][:, ::-1]
    walls = triangles(corners, emission=(1.0, 1.0, 1.0), name="walls")
    corners = np.array([[-1.0, -0.99, 0.5], [0.99, 1.0, 0.6], [1.0, -1.0, 0.55]])
    large = triangles(corners[None], 1, (1.0, 1.0, 1.0), name="large")
    # Two faces in one place would not do: the first is seen from both sides, and the wrong one is black.
    back = triangles(corners[None, ::-1] + [0.0, 0.0, 1e-3], 1, (1.0, 1.0, 1.0), name="back of it")
    wall = diffuse("wall", (0.5, 0.5, 0.5))
    what = scene([walls, large, back], glowing_box().camera, [wall, wall])
    image = run.render(what, photons=100_000 if run.full else 10_000, spp=64 if run.full else 16, light_samples=4)
    run.check_share("radiance", image.pixels.mean(axis=(0, 1)), 2.0, 0.015 if run.full else 0.03)


@hard_case(
    "boxes of 1e-20 and 1e15",
    section=2,
    shows="areas whose squares leave float32's range",
    expected="a closed furnace: 2",
    tolerance="2 %: noise",
)
def boxes_of_any_scale(run: Run) -> None:
    """Areas of triangles of 1e-20 and of 1e15 have squares that float32 does not hold."""
    radii = []
    for size in (1e-20, 1.0, 1e15):
        image = run.render(scaled(glowing_box(), size), photons=5_000, spp=64, light_samples=4, cells=1)
        run.check_share(f"radiance in a box of {size:g}", image.pixels.mean(), 2.0, 0.02)
        report = image.metadata["report"]
        run.check_share("power emitted", report["energy"]["emitted"], np.pi * 24.0 * size**2, 1e-4)
        radii.append(report["settings"]["gather_radius"] / size)
    run.check_share("gather radius in sizes of the box", radii, [radii[1]] * 3, 1e-6)
