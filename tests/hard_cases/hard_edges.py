"""Section 2: edges of walls, through which no ray may get."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import warp as wp
from case import Run, hard_case
from rooms import quad, scene, triangles, view

from wdpm.kernels.constants import PAD_SHARE
from wdpm.kernels.rays import bvh
from wdpm.kernels.rays.bvh import Bvh, any_hit
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Mesh

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NOT_HIT = 1.5
"""Where shadow rays of the watertight box end, in units of their way to its wall: outside."""

BLACK = "none: not a single ray may get through"


@wp.kernel
def blocked_kernel(
    tree: Bvh, origin: wp.array[wp.vec3], direction: wp.array[wp.vec3], end: wp.float32, out: wp.array[wp.bool]
) -> None:
    """Whether each segment meets anything."""
    i = wp.tid()
    out[i] = any_hit(tree, origin[i], direction[i], end)


def tessellated_box(t_junctions: bool) -> Mesh:
    """The box [-1, 1]³ of squares; with T-junctions, each wall has squares of another size than its neighbours."""
    soup = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            count = 4 * (1 + axis + (side > 0)) if t_junctions else 4
            cuts = np.linspace(-1.0, 1.0, count + 1)
            for x0, x1 in pairwise(cuts):
                for y0, y1 in pairwise(cuts):
                    square = np.insert(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]), axis, side, axis=1)
                    soup += [square[[0, 1, 2]], square[[0, 2, 3]]]
    return triangles(np.array(soup), name="box")


def _through_edges(run: Run, mesh: Mesh) -> None:
    """Segments from inside, aimed past edges and corners: all must be blocked."""
    rays = run.rays or (20_000_000 if run.full else 200_000)
    corners = mesh.vertices[mesh.faces].astype(np.float32)
    tree = bvh.build(corners, np.arange(len(corners), dtype=np.int32), float(np.float32(PAD_SHARE)))
    rng = np.random.default_rng(1)
    leaks, done, batch = 0, 0, 1 << 18
    while done < rays:
        count = min(batch, rays - done)
        chosen = corners[rng.integers(0, len(corners), count)].astype(np.float64)
        share = rng.choice([0.0, 0.5, 1.0, 1 / 3, -1.0], count)
        share = np.where(share < 0, rng.random(count), share)[:, None]
        edge = rng.integers(0, 3, count)
        a, b = chosen[np.arange(count), edge], chosen[np.arange(count), (edge + 1) % 3]
        origin = rng.uniform(-0.9, 0.9, (count, 3)).astype(np.float32)
        some = rng.random(count) < 0.3  # from places in line with edges and corners
        origin[some] = (np.round(origin[some] * 8) / 8).astype(np.float32)
        direction = ((a + share * (b - a)).astype(np.float32) - origin).astype(np.float32)
        arrays = [wp.array(x, dtype=wp.vec3, device="cpu") for x in (origin, direction)]
        out = wp.empty(count, dtype=wp.bool, device="cpu")
        wp.launch(blocked_kernel, count, inputs=[tree, *arrays, NOT_HIT], outputs=[out], device="cpu")
        leaks += int(count - out.numpy().sum())
        done += count
    run.check(f"leaks of {rays:,} segments at edges and corners", leaks, 0, 0)


def _dark_box(run: Run, mesh: Mesh) -> None:
    """Lights all around a closed box, and one near an edge: inside it is black, exactly."""
    lights = [PointLight("point", place, (1e6, 1e6, 1e6)) for place in ((1.0 + 1e-5, 1.0 + 1e-5, 0.3), (2.0, 0.0, 0.0))]
    lamp = quad((-3.0, 2.0, -3.0), (6.0, 0, 0), (0, 0, 6.0), emission=(1e6, 1e6, 1e6), name="lamp")
    what = scene([mesh, lamp], view((0.1, 0.2, -0.9), (1.0, 1.0, 1.0), 100, 32 if run.full else 12), lights=lights)
    image = run.render(what, photons=20_000 if run.full else 2_000, spp=16 if run.full else 2)
    run.check("brightest pixel of direct light", image.layers["direct"].max(), 0, 0)
    run.check("brightest pixel of indirect light", image.layers["indirect"].max(), 0, 0)


@hard_case(
    "a watertight box",
    section=2,
    shows="lights outside, shared edges and corners aimed at",
    expected="black",
    tolerance=BLACK,
)
def watertight_box(run: Run) -> None:
    mesh = tessellated_box(False)
    _dark_box(run, mesh)
    _through_edges(run, mesh)


@hard_case(
    "T-junctions", section=2, shows="walls cut up otherwise than their neighbours", expected="black", tolerance=BLACK
)
def t_junctions(run: Run) -> None:
    _dark_box(run, tessellated_box(True))


@hard_case(
    "aimed at T-junctions exactly",
    section=2,
    shows="segments whose ends lie on the very line of the edge, in floats",
    expected="blocked",
    tolerance=BLACK,
)
def aimed_at_t_junctions(run: Run) -> None:
    _through_edges(run, tessellated_box(True))
