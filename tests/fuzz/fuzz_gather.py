"""Gathers of photons/gather.py against all photons by themselves: the very set of the k nearest, and every bit of what
follows from it.

The oracle computes distances and filters with NumPy in float32, operation by operation as the contract says (a photon's
own numbers decide, by (distance², id)), and the rest by sorting. It knows no tree, no guess and no candidate buffer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from awkward_places import AXES, F32, KIND_NAMES, Array, dot, make_ids, make_positions, make_queries, unit
from fuzz_failure import Failure

from wdpm.kernels.constants import (
    ADJOINT_BOUND,
    COINCIDENT_SHARE2,
    EXACT_SUM_BITS,
    FLATTENING,
    LEAST_SQUARE,
    MIN_ARRIVAL_COS,
    NORMAL_COS,
)
from wdpm.kernels.photons import photon_map
from wdpm.kernels.photons.gather import INT_SCRATCH, KEY_SCRATCH, MAX_K, gather_kernel, key_place, nearest
from wdpm.kernels.photons.gather_guess import follow
from wdpm.kernels.photons.photon_map import PhotonMap

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

QUERIES = 512
RUN = 16
RADII = (1e-12, 1e-6, 0.01, 0.125, 0.3, 1.0, 1e4, 1e15)


@dataclass(frozen=True)
class Case:
    """Photons and queries, a dictionary of columns each, and the settings."""

    photons: dict[str, Array]
    position: Array
    normal: Array
    shading: Array
    k: int
    r_max: float


@dataclass(frozen=True)
class Result:
    """Of each query: the ids of the photons that count, ascending, and what the kernel returns."""

    ids: list[Array]
    irradiance: Array
    count: Array
    radius: Array
    truncated: Array


@wp.kernel
def nearest_kernel(
    photons: PhotonMap,
    position: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    k: wp.int32,
    r_max: wp.float32,
    run: wp.int32,
    count_out: wp.array[wp.int32],
    rank_out: wp.array2d[wp.int32],
) -> None:
    """The ranks of the photons that each gather uses; guesses follow from query to query, as in gather_kernel."""
    candidates = wp.zeros(shape=(KEY_SCRATCH,), dtype=wp.uint64)
    ints = wp.zeros(shape=(INT_SCRATCH,), dtype=wp.int32)
    begin = wp.tid() * run
    end = wp.min(begin + run, position.shape[0])
    guess = wp.float32(0.0)
    before = wp.vec3(0.0)
    for q in range(begin, end):
        x = position[q]
        if q > begin:
            guess = follow(guess, wp.length(x - before))
        found = nearest(photons, x, normal[q], k, r_max, guess, candidates, ints)
        count_out[q] = found.count
        for i in range(found.count):
            rank_out[q, i] = photons.rank[key_place(candidates[i])]
        guess = found.radius
        before = x


def make_case(seed: int) -> Case:
    """Up to 4000 photons of one kind, and queries at photons and anywhere."""
    rng = np.random.default_rng(seed)
    kind = str(rng.choice(KIND_NAMES))
    count = int(rng.choice([0, 1, 2, 7, 8, 9, 64, 65, 513])) if rng.random() < 0.15 else int(2 ** rng.uniform(0, 12))
    k = int(rng.choice([1, 2, 3, 8, 50, 200, MAX_K]))
    r_max = float(rng.choice(RADII)) if rng.random() < 0.5 else float(10.0 ** rng.uniform(-3, 1))
    return case_of(rng, kind, count, k, r_max)


def case_of(rng: np.random.Generator, kind: str, count: int, k: int, r_max: float, queries: int = QUERIES) -> Case:
    """So many photons of a kind, and queries."""
    position = make_positions(rng, kind, count)
    normal = AXES[rng.choice([0, 1, 2, 2, 2, 5], count)]
    if rng.random() < 0.4:  # a curved surface: cosines on both sides of the filter
        normal = unit(normal + rng.uniform(0, 0.6) * rng.normal(size=(count, 3)))
    photons = {
        "position": position,
        "flux": (rng.random((count, 3)) * 10.0 ** rng.integers(-8, 8, (count, 1))).astype(F32),
        "normal": normal,
        "direction": unit(rng.normal(size=(count, 3)) + normal),
        "id": make_ids(rng, count),
    }
    x = make_queries(rng, kind, position, queries)
    if rng.random() < 0.5:  # a coherent run
        x = x[np.argsort(x[:, 0], kind="stable")]
    n = AXES[rng.choice([2, 2, 5, 1], queries)]
    tilted = unit(n + 0.3 * rng.normal(size=(queries, 3)))
    shading = np.where(rng.random((queries, 1)) < 0.5, n, tilted).astype(F32)
    return Case(photons, x, n, shading, k, r_max)


def gather_all(case: Case) -> Result:
    """What the kernels say."""
    photons = photon_map.build(**case.photons)
    count = len(case.position)
    columns = (case.position, case.normal, case.shading)
    queries = [wp.array(np.ascontiguousarray(column), dtype=wp.vec3, device="cpu") for column in columns]
    outputs = [wp.zeros(count, dtype=t, device="cpu") for t in (wp.vec3, wp.int32, wp.float32, wp.bool)]
    threads = -(-count // RUN)
    scalars = [case.k, case.r_max, 0.0, 0, RUN]
    wp.launch(gather_kernel, threads, inputs=[photons, *queries, *scalars], outputs=outputs, device="cpu")
    used = wp.zeros(count, dtype=wp.int32, device="cpu")
    ranks = wp.zeros((count, case.k), dtype=wp.int32, device="cpu")
    inputs = [photons, *queries[:2], case.k, case.r_max, RUN]
    wp.launch(nearest_kernel, threads, inputs=inputs, outputs=[used, ranks], device="cpu")
    by_rank = np.sort(case.photons["id"])
    ids = [by_rank[np.sort(row[:n])] for row, n in zip(ranks.numpy(), used.numpy(), strict=True)]
    return Result(ids, *(out.numpy() for out in outputs))


def expect(case: Case) -> Result:
    """What the contract says."""
    id_of = case.photons["id"]
    rank = np.argsort(np.argsort(id_of))
    position, facing, direction = (case.photons[name] for name in ("position", "normal", "direction"))
    irradiance = np.zeros((len(case.position), 3), F32)
    counts, radii, truncated, ids = [], [], [], []
    r_max2 = F32(case.r_max) * F32(case.r_max)
    least2 = max(r_max2 * F32(COINCIDENT_SHARE2), F32(LEAST_SQUARE))
    for q, (x, n, s) in enumerate(zip(case.position, case.normal, case.shading, strict=True)):
        d = position - x
        height = dot(d, n)
        d2 = dot(d, d) + F32(FLATTENING**2 - 1) * (height * height)
        passes = (d2 <= r_max2) & (dot(facing, n) > F32(NORMAL_COS))
        found = np.flatnonzero(passes)
        found = found[np.lexsort((rank[found], d2[found]))[: case.k + 1]]
        full = len(found) > case.k
        area2, radius = r_max2, F32(case.r_max)
        if full and d2[found[case.k]] >= least2:
            area2 = d2[found[case.k]]
            radius = np.sqrt(area2)
        used = found[: case.k]
        irradiance[q] = _estimate(case.photons["flux"][used], facing[used], direction[used], s - n, area2)
        counts.append(len(used))
        radii.append(radius)
        truncated.append(not full)
        ids.append(np.sort(id_of[used]))
    return Result(ids, irradiance, np.array(counts), np.array(radii, F32), np.array(truncated))


def _estimate(flux: Array, facing: Array, direction: Array, lean: Array, area2: Any) -> Array:
    terms = flux
    if lean.any():
        arriving = dot(facing, direction)
        leaning = np.maximum(arriving + dot(lean, direction), F32(0))
        weight = np.minimum(leaning / np.maximum(arriving, F32(MIN_ARRIVAL_COS)), F32(ADJOINT_BOUND))
        terms = terms * weight[:, None]
    largest = float(np.abs(terms).max(initial=0))
    quantum = 2.0 ** (max(math.frexp(largest)[1], -126) - EXACT_SUM_BITS)
    # Whole numbers below 2^40, at most 500 of them: float64 adds them exactly.
    total = np.rint(terms.astype(float) / quantum).sum(axis=0) * quantum
    return (total / (math.pi * float(area2))).astype(F32)


def judge(case: Case, found: Result, expected: Result) -> list[Failure]:
    """The queries whose photons or results differ."""
    wrong = {
        "count": found.count != expected.count,
        "radius": found.radius.view(np.uint32) != expected.radius.view(np.uint32),
        "truncated": found.truncated != expected.truncated,
        # Adding 0 makes -0 equal to 0.
        "irradiance": ((found.irradiance + 0).view(np.uint32) != (expected.irradiance + 0).view(np.uint32)).any(axis=1),
        "set of photons": np.array(
            [not np.array_equal(a, b) for a, b in zip(found.ids, expected.ids, strict=True)], np.bool_
        ),
    }
    failures = []
    for q in np.flatnonzero(np.any(list(wrong.values()), axis=0)):
        names = ", ".join(name for name, bad in wrong.items() if bad[q])
        data = case.photons | {"k": np.array(case.k), "r_max": np.array(case.r_max)}
        data |= {"x": case.position[q], "n": case.normal[q], "s": case.shading[q]}
        failures.append(Failure(f"query {q}: another {names}", data))
    return failures


def run_case(seed: int) -> tuple[int, list[Failure]]:
    """Gathers done, and what went wrong with them."""
    case = make_case(seed)
    return len(case.position), judge(case, gather_all(case), expect(case))
