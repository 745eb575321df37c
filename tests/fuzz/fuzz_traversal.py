"""Nearest and any hits of rays/bvh.py against testing every triangle, in the renderer's arithmetic and in others.

Three judges look at each ray:

* every triangle by intersect_triangle, smallest (t, id): the tree must give the same bits, and any_hit must agree;
* every triangle by Cramer's rule in float64, which shares no line with the renderer; what it holds against the renderer
  goes to exact arithmetic (fuzz_referee.py): a triangle that is surely met before the hit found is a *missed* hit;
* the point of the triangle that a hit names must lie on the ray: otherwise the hit is *invented*.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from fuzz_failure import Failure
from fuzz_rays import rays_at
from fuzz_referee import first_sure_meeting, off_the_ray
from fuzz_shapes import KINDS, scaled, triangle_set

from wdpm.kernels.constants import PAD_SHARE
from wdpm.kernels.rays import bvh
from wdpm.kernels.rays.bvh import Bvh, Hit, any_hit, closest_hit, no_hit
from wdpm.kernels.rays.triangle import NO_HIT, intersect_triangle, make_ray

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Array = npt.NDArray[Any]
F32 = np.float32
FIELDS = ("t", "prim", "u", "v")
RAYS = 4096

ON_RAY = 2.0**-20
"""How far a hit's point may be off its ray, as a share of the reach: t, u and v are rounded to float32 (2^-24 of each),
weights are known to 2^-22, and clamping to a box moves t by 3 * 2^-24."""

SUSPECT = wp.constant(2.0**-53)
"""The float64 judge's margin: below its own rounding errors on purpose, since exact arithmetic has the last word."""

SLACK = wp.constant(2.0**-20)
"""How far above the judge's t a hit is let pass, as a share of t and of the triangle's longest edge."""

FAR = wp.constant(1.0e300)


@dataclass(frozen=True)
class Case:
    """Triangles with their ids, rays, and the growth of boxes."""

    triangles: Array
    ids: Array
    origin: Array
    direction: Array
    pad: float

    @property
    def grown_enough(self) -> bool:
        """Whether boxes are grown by their share of all that rays start from and meet, as in a render.

        Flat boxes along the axes that are not are thinner than what a ray from their side is off, and the clamp then
        moves t away from the weights: tree and judges must still agree, but t and (u, v) need not.
        """
        extent = max(float(np.abs(self.triangles).max()), float(np.abs(self.origin).max()))
        return self.pad >= 0.99 * PAD_SHARE * extent

    def failure(self, message: str, ray: int) -> Failure:
        """The failure of one ray."""
        data = {"triangles": self.triangles, "ids": self.ids, "pad": np.array(self.pad)}
        return Failure(message, data | {"origin": self.origin[ray], "direction": self.direction[ray]})


@dataclass
class Traced:
    """What the renderer and the judges say of each ray.

    Attributes:
        found, plain: the nearest hit by the tree, and by testing every triangle; structured arrays (t, prim, u, v).
        sure: a t before which the float64 judge wants a hit; inf where it wants none.
        blocked: whether any_hit sees something before t, before the next float, and anywhere, bool, shape [R, 3].
    """

    found: Array
    plain: Array
    sure: Array
    blocked: Array


@wp.func
def sure_t(a: wp.vec3, b: wp.vec3, c: wp.vec3, origin: wp.vec3, direction: wp.vec3) -> wp.float64:
    """Above where the ray meets the triangle, if that is not in doubt; else FAR. Cramer's rule."""
    e1 = wp.vec3d(b) - wp.vec3d(a)
    e2 = wp.vec3d(c) - wp.vec3d(a)
    s = wp.vec3d(origin) - wp.vec3d(a)
    d = wp.vec3d(direction)
    normal = wp.cross(e1, e2)
    det = -wp.dot(d, normal)
    q = wp.cross(s, d)
    u = wp.dot(e2, q)
    v = -wp.dot(e1, q)
    w = det - u - v
    length = wp.length(d)
    edge = wp.max(wp.length(e1), wp.length(e2))
    margin = wp.float64(SUSPECT) * (wp.length(s) + edge) * edge * length
    inside = (u > margin and v > margin and w > margin) or (u < -margin and v < -margin and w < -margin)
    t = wp.float64(FAR)
    if inside:
        t = wp.dot(s, normal) / det
        slack = wp.float64(SLACK) * (wp.abs(t) + edge / length)
        t = wp.where(t > slack, t + slack, wp.float64(FAR))
    return t


@wp.kernel
def judge_kernel(
    tree: Bvh,
    corners: wp.array2d[wp.vec3],
    ids: wp.array[wp.int32],
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    found_out: wp.array[Hit],
    plain_out: wp.array[Hit],
    sure_out: wp.array[wp.float64],
    blocked_out: wp.array2d[wp.bool],
) -> None:
    """One ray: the tree's answer, that of every triangle in the renderer's arithmetic, and in Cramer's."""
    i = wp.tid()
    o = origin[i]
    d = direction[i]
    found = closest_hit(tree, o, d, no_hit())
    plain = no_hit()
    ray = make_ray(o, d)
    sure = wp.float64(FAR)
    for k in range(corners.shape[0]):
        a = corners[k, 0]
        b = corners[k, 1]
        c = corners[k, 2]
        hit = intersect_triangle(a, b, c, ray, tree.pad)
        if hit[0] < plain.t or (hit[0] == plain.t and hit[0] < NO_HIT and ids[k] < plain.prim):
            plain.t = hit[0]
            plain.prim = ids[k]
            plain.u = hit[1]
            plain.v = hit[2]
        sure = wp.min(sure, sure_t(a, b, c, o, d))
    found_out[i] = found
    plain_out[i] = plain
    sure_out[i] = sure
    above = wp.cast(wp.cast(found.t, wp.uint32) + wp.uint32(1), wp.float32)
    blocked_out[i, 0] = any_hit(tree, o, d, found.t)
    blocked_out[i, 1] = any_hit(tree, o, d, above)
    blocked_out[i, 2] = any_hit(tree, o, d, wp.float32(NO_HIT))


def make_case(seed: int, kinds: tuple[str, ...] | None = None, rays: int = RAYS) -> Case:
    """The case of a seed: up to 256 triangles of one to three kinds at any scale, and rays."""
    rng = np.random.default_rng(seed)
    if kinds is None:
        kinds = tuple(rng.choice(list(KINDS), rng.integers(1, 4)))
    triangles = triangle_set(rng, kinds, int(2 ** rng.uniform(0, 8)))
    if rng.random() < 0.5:
        triangles = scaled(triangles, 10.0 ** rng.uniform(-6, 6))
    ids = rng.permutation(4 * len(triangles))[: len(triangles)].astype(np.int32)
    origin, direction = rays_at(rng, triangles, rays)
    reaches = [float(np.abs(a).max()) for a in (triangles, origin)]
    extent = rng.choice([max(reaches), reaches[0], 0.0], p=[0.7, 0.15, 0.15])
    return Case(triangles, ids, origin, direction, float(F32(PAD_SHARE * extent)))


def trace(case: Case) -> Traced:
    """What the renderer and the judges say."""
    count = len(case.origin)
    tree = bvh.build(case.triangles, case.ids, case.pad)
    corners = wp.array(np.ascontiguousarray(case.triangles), dtype=wp.vec3, device="cpu").reshape((-1, 3))
    rays = [wp.array(np.ascontiguousarray(a), dtype=wp.vec3, device="cpu") for a in (case.origin, case.direction)]
    hits = [wp.empty(count, dtype=Hit, device="cpu") for _ in range(2)]
    sure = wp.empty(count, dtype=wp.float64, device="cpu")
    blocked = wp.empty((count, 3), dtype=wp.bool, device="cpu")
    ids = wp.array(case.ids, dtype=wp.int32, device="cpu")
    wp.launch(judge_kernel, count, inputs=[tree, corners, ids, *rays], outputs=[*hits, sure, blocked], device="cpu")
    t = sure.numpy()
    return Traced(hits[0].numpy(), hits[1].numpy(), np.where(t < FAR, t, np.inf), blocked.numpy())


def judge(case: Case, traced: Traced) -> list[Failure]:
    """All that is wrong with the renderer's answers."""
    found = traced.found
    differs = np.any([found[name].view(np.int32) != traced.plain[name].view(np.int32) for name in FIELDS], axis=0)
    failures = [case.failure("the tree and every triangle by itself disagree", i) for i in np.flatnonzero(differs)]
    hit = found["prim"] >= 0
    wrong = traced.blocked != np.stack([np.zeros_like(hit), hit, hit], axis=1)
    failures += [case.failure("any_hit disagrees with closest_hit", i) for i in np.flatnonzero(wrong.any(axis=1))]
    failures += _missed(case, traced)
    return failures + (_invented(case, traced) if case.grown_enough else [])


def _missed(case: Case, traced: Traced) -> list[Failure]:
    failures = []
    t = np.where(traced.found["prim"] >= 0, traced.found["t"].astype(float), np.inf)
    for i in np.flatnonzero(t > traced.sure):
        first = first_sure_meeting(case.triangles, case.origin[i], case.direction[i])
        if first is not None and t[i] > first[1].t + first[1].slack:
            row, meeting = first
            message = f"missed: triangle {case.ids[row]} is met at {meeting.t!r}, found was {t[i]!r}"
            failures.append(case.failure(message, i))
    return failures


def _invented(case: Case, traced: Traced) -> list[Failure]:
    rows = np.flatnonzero(traced.found["prim"] >= 0)
    hits = traced.found[rows]
    place = np.full(int(case.ids.max()) + 1, -1)
    place[case.ids] = np.arange(len(case.ids))
    triangle = case.triangles[place[hits["prim"]]].astype(float)
    origin, direction = case.origin[rows].astype(float), case.direction[rows].astype(float)
    t, u, v = (hits[name].astype(float)[:, None] for name in ("t", "u", "v"))
    a, b, c = triangle.swapaxes(0, 1)
    gap = np.linalg.norm(a + u * (b - a) + v * (c - a) - (origin + t * direction), axis=1)
    reach = np.linalg.norm(triangle - origin[:, None], axis=2).max(axis=1)
    bad = (gap > ON_RAY * reach) | (np.minimum(u, v)[:, 0] < 0) | ((u + v)[:, 0] > 1 + 2.0**-22) | (t[:, 0] <= 0)
    failures = []
    for n in np.flatnonzero(bad):
        i, hit = rows[n], hits[n]
        off = off_the_ray(triangle[n], case.origin[i], case.direction[i], hit["t"], hit["u"], hit["v"])
        shown = ", ".join(f"{name} {hit[name]!r}" for name in FIELDS)
        failures.append(case.failure(f"invented: {shown}; {off / reach[n]:.3g} of its reach off the ray", i))
    return failures


def run_case(seed: int) -> tuple[int, list[Failure]]:
    """Rays traced, and what went wrong with them."""
    case = make_case(seed)
    return len(case.origin), judge(case, trace(case))
