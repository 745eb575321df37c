"""Balls as bounds of subtrees: they skip no hit, and spare shadow rays to lamps that are balls the lamps' triangles."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from traversal_rig import F32, Array, any_kernel, trace

from wdpm.kernels.constants import PAD_SHARE
from wdpm.kernels.lights.balls import way_to_ball
from wdpm.kernels.lights.importance import LightNode
from wdpm.kernels.rays import ball_bounds, bvh
from wdpm.kernels.rays.ball_bounds import BallBounds, Balls, passes_by
from wdpm.scenes.meshes import primitives

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def ways_kernel(
    nodes: wp.array[LightNode],
    ball: wp.array[wp.int32],
    origin: wp.array[wp.vec3],
    u: wp.array[wp.vec2],
    end_out: wp.array[wp.vec3],
):
    i = wp.tid()
    node = nodes[ball[i]]
    way = way_to_ball(node, node.radius, origin[i], u[i])
    end_out[i] = way.end + way.normal * way.clearance


@wp.kernel
def passes_kernel(
    bounds: BallBounds,
    ball: wp.array[wp.int32],
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    out: wp.array[wp.bool],
):
    i = wp.tid()
    out[i] = passes_by(bounds, ball[i], origin[i], direction[i], 1.0)


class Lamps:
    """Balls of several sizes about a place, with other triangles in between.

    Args:
        place: of the scene.
        rng: where they stand.
    """

    def __init__(self, place: Array, rng: np.random.Generator) -> None:
        mesh = primitives.sphere(64, true_area=True)
        self.radius = np.array([1.0, 0.3, 0.02])
        middle = rng.uniform(-3.0, 3.0, (3, 3)) + place
        meshes = [mesh.vertices[mesh.faces] * r + m for r, m in zip(self.radius, middle, strict=True)]
        others = rng.uniform(-3.0, 3.0, (400, 1, 3)) + rng.normal(size=(400, 3, 3)) * 0.2 + place
        self.positions = np.concatenate([*meshes, others]).astype(F32)
        self.emitter = np.repeat([4, 1, 2, -1], [len(mesh.faces)] * 3 + [400]).astype(np.int32)
        self.balls = Balls(np.array([4, 1, 2], np.int32), middle.astype(F32))
        self.pad = float(F32(np.abs(self.positions).max() * PAD_SHARE))
        self.plain = bvh.build(self.positions, np.arange(len(self.positions), dtype=np.int32), self.pad)
        self.bounded = bvh.build(self.positions, np.arange(len(self.positions), dtype=np.int32), self.pad)
        rows, children = self.bounded.ids.numpy(), self.bounded.children.numpy()
        self.of_leaves = self.emitter[rows]
        self.bounded.balls = ball_bounds.bound(children, rows, self.positions, self.emitter, self.balls, "cpu")

    def ends(self, ball: Array, origin: Array, u: Array) -> Array:
        """Where shadow rays to balls end."""
        nodes = np.zeros(3, LightNode.numpy_dtype())
        center = self.balls.center
        far = [
            np.linalg.norm(self.positions[self.emitter == e] - c, axis=2).max()
            for e, c in zip((4, 1, 2), center, strict=True)
        ]
        nodes["center"], nodes["radius"] = center, F32(far)
        nodes["radius2"] = nodes["radius"] ** 2
        out = wp.zeros(len(origin), dtype=wp.vec3, device="cpu")
        inputs = [wp.array(nodes, dtype=LightNode, device="cpu"), ints(ball), vectors(origin)]
        inputs += [wp.array(u.astype(F32), dtype=wp.vec2, device="cpu"), out]
        wp.launch(ways_kernel, len(origin), inputs=inputs, device="cpu")
        return out.numpy()


def vectors(values: Array) -> Array:
    return wp.array(values.astype(F32), dtype=wp.vec3, device="cpu")


def ints(values: Array) -> Array:
    return wp.array(values.astype(np.int32), dtype=wp.int32, device="cpu")


def blocked(tree: Array, origin: Array, direction: Array, t_max: Array) -> Array:
    out = wp.zeros(len(origin), dtype=wp.bool, device="cpu")
    ends = wp.array(t_max.astype(F32), dtype=wp.float32, device="cpu")
    wp.launch(any_kernel, len(origin), inputs=[tree, vectors(origin), vectors(direction), ends, out], device="cpu")
    return out.numpy()


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (30.0, -100.0, 7.0)])
def test_balls_skip_no_hit(place: tuple[float, float, float]) -> None:
    """Rays of any kind, and such as graze balls or end at them, from outside and from within."""
    rng = np.random.default_rng(3)
    lamps, count = Lamps(np.array(place), rng), 30_000
    ball = rng.integers(0, 3, count)
    center, radius = lamps.balls.center[ball].astype(np.float64), lamps.radius[ball, None]
    way = rng.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    origin = center + way * radius * np.exp(rng.uniform(-0.01, 5.0, (count, 1)))
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    near = rng.choice([0.99, 0.999, 0.99999, 1.0, 1.000001, 1.001, 1.1], (count, 1))
    direction = (center + normal * radius * near - origin).astype(F32)
    for t_max in (np.full(count, 1.0), rng.uniform(0.0, 3.0, count)):
        hits = blocked(lamps.plain, origin, direction, t_max)
        assert 0.1 < hits.mean() < 0.9
        np.testing.assert_array_equal(blocked(lamps.bounded, origin, direction, t_max), hits)


@pytest.mark.parametrize("far", [2.0**8, 2.0**14, 2.0**17])
def test_balls_skip_no_hit_of_far_rays_along_triangles(far: float) -> None:
    """What a ray meets of a triangle that it sees from its side may be beside the ray; here it ends right behind."""
    rng = np.random.default_rng(11)
    lamps, count = Lamps(np.zeros(3), rng), 100_000
    chosen = rng.choice(np.flatnonzero(lamps.emitter >= 0), count)
    corners = lamps.positions[chosen].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    along = np.cross(normal, rng.normal(size=(count, 3)))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    radius = lamps.radius[np.select([lamps.emitter[chosen] == 4, lamps.emitter[chosen] == 1], [0, 1], 2), None]
    there = (corners * rng.dirichlet([0.3, 0.3, 0.3], count)[:, :, None]).sum(axis=1)
    origin = (there - along * radius * far).astype(F32)
    direction = (there - origin).astype(F32)
    behind = np.nextafter(trace(lamps.plain, origin, direction)["t"], F32(np.inf))
    hits = blocked(lamps.plain, origin, direction, behind)
    assert 0.3 < hits.mean() < 0.9
    np.testing.assert_array_equal(blocked(lamps.bounded, origin, direction, behind), hits)


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (30.0, -100.0, 7.0)])
def test_shadow_rays_pass_by_the_balls_that_they_lead_to(place: tuple[float, float, float]) -> None:
    """All of them: so none looks for triangles of its lamp."""
    rng = np.random.default_rng(5)
    lamps, count = Lamps(np.array(place), rng), 30_000
    ball = rng.integers(0, 3, count)
    way = rng.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    origin = lamps.balls.center[ball] + way * lamps.radius[ball, None] * np.exp(rng.uniform(0.01, 12.0, (count, 1)))
    origin = origin.astype(F32)
    direction = lamps.ends(ball, origin, rng.random((count, 2))) - origin
    out = wp.zeros(count, dtype=wp.bool, device="cpu")
    inputs = [lamps.bounded.balls, ints(ball), vectors(origin), vectors(direction), out]
    wp.launch(passes_kernel, count, inputs=inputs, device="cpu")
    assert out.numpy().all()


def test_children_that_are_in_balls() -> None:
    """Those all of whose triangles belong to one, but for what lies below such a child."""
    lamps = Lamps(np.zeros(3), np.random.default_rng(7))
    children, bounds = lamps.bounded.children.numpy(), lamps.bounded.balls
    found, mask = bounds.ball.numpy(), bounds.mask.numpy()
    np.testing.assert_array_equal((found >= 0) @ (1 << np.arange(8)), mask)
    number = {4: 0, 1: 1, 2: 2, -1: -1}

    def below(code: int) -> set[int]:
        if code < 0:
            first = (-code - 1) >> 3
            return {number[e] for e in lamps.of_leaves[first : first - code - 8 * first].tolist()}
        return set().union(*(below(child) for child in children[code].tolist() if child != 0))

    seen = np.zeros(3, np.int64)
    todo = [(0, False)]
    while todo:
        node, inside = todo.pop()
        for lane, code in enumerate(children[node].tolist()):
            if code == 0:
                assert found[node, lane] == -1
                continue
            of = below(code)
            expected = of.pop() if len(of) == 1 and not inside else -1
            assert found[node, lane] == expected
            seen[expected] += expected >= 0
            if code > 0:
                todo.append((code, inside or expected >= 0))
    assert (seen > 0).all()


def test_no_balls_no_bounds() -> None:
    assert ball_bounds.no_bounds("cpu").mask.shape == (0,)
