"""Indirect light against a path tracer written plainly in numpy, and the energy ledger of photons."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnaces import Array, box, hollow_sphere, quad, scene, view

from wdpm.cluster.render_settings import RenderSettings
from wdpm.kernels.materials.types import DIFFUSE
from wdpm.rendering.in_process import render_in_process
from wdpm.report.report import EnergyLedger
from wdpm.scenes.builtin.cornell_box import cornell_box
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Scene, diffuse
from wdpm.scenes.model.textures import RGB


class PathTracer:
    """Unidirectional, with next-event estimation at every vertex; each ray is tried against each triangle.

    Plain on purpose: the only thing it shares with the renderer is the scene. Surfaces reflect on their front.
    """

    def __init__(self, what: Scene, seed: int) -> None:
        flat = flatten(what)
        t = flat.triangles
        self.rng = np.random.default_rng(seed)
        self.a = t.positions[:, 0].astype(float)
        self.e1, self.e2 = (t.positions[:, i].astype(float) - self.a for i in (1, 2))
        cross = np.cross(self.e1, self.e2)
        self.area = np.linalg.norm(cross, axis=1) / 2
        self.normal = cross / (2 * self.area[:, None])
        assert (flat.materials.kind[t.material] == DIFFUSE).all()
        self.albedo = flat.materials.value[t.material, 0].astype(float)
        self.radiance = np.where(
            t.emitter[:, None] >= 0, np.append(flat.lights.emitter_radiance, [[0, 0, 0]], axis=0)[t.emitter], 0
        )
        self.camera = flat.camera

    def hit(self, origin: Array, direction: Array) -> tuple[Array, Array]:
        """Distance and triangle of the nearest hit beyond 1e-6 (Moeller & Trumbore), inf and 0 where there is none."""
        p = np.cross(direction[:, None], self.e2)
        det = np.einsum("ta,rta->rt", self.e1, p)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = origin[:, None] - self.a
            u = np.einsum("rta,rta->rt", s, p) / det
            q = np.cross(s, self.e1)
            v = np.einsum("ra,rta->rt", direction, q) / det
            t = np.einsum("ta,rta->rt", self.e2, q) / det
            inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-6)
        t = np.where(inside, t, np.inf)
        nearest = t.argmin(axis=1)
        return t[np.arange(len(t)), nearest], nearest

    def direct(self, x: Array, n: Array) -> Array:
        """Irradiance by one sample of the lights, shape [rays, 3]."""
        power = self.area * self.radiance.mean(axis=1)
        chosen = self.rng.choice(len(power), len(x), p=power / power.sum())
        r = np.sqrt(self.rng.random((len(x), 1)))
        s = self.rng.random((len(x), 1))
        y = self.a[chosen] + r * (1 - s) * self.e1[chosen] + r * s * self.e2[chosen]
        d = y - x
        d2 = (d**2).sum(axis=1)
        d /= np.sqrt(d2)[:, None]
        cos_x = np.maximum(np.einsum("ra,ra->r", d, n), 0)
        cos_y = np.maximum(-np.einsum("ra,ra->r", d, self.normal[chosen]), 0)
        t, _ = self.hit(x + 1e-7 * n, d)
        visible = t > np.sqrt(d2) * (1 - 1e-5)
        weight = visible * cos_x * cos_y / d2 * self.area[chosen] * power.sum() / power[chosen]
        return self.radiance[chosen] * weight[:, None]

    def scattered(self, n: Array) -> Array:
        """Directions by the cosine about n: n plus a point of the unit sphere."""
        z = self.rng.uniform(-1, 1, len(n))
        phi = self.rng.uniform(0, 2 * np.pi, len(n))
        r = np.sqrt(1 - z * z)
        d = n + np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)
        return np.asarray(d / np.linalg.norm(d, axis=1, keepdims=True))

    def indirect(self, count: int, bounces: int) -> Array:
        """What `count` random camera rays see of light that was reflected at least twice, shape [count, 3]."""
        c = self.camera
        half = np.tan(np.radians(c.fov_x) / 2)
        x, y = self.rng.uniform(-half, half, (2, count))
        direction = np.stack([x, y * c.height / c.width, np.ones(count)], axis=1) @ c.to_world[:3, :3].T
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        origin = np.broadcast_to(c.to_world[:3, 3], direction.shape)
        weight = np.ones((count, 3))
        total = np.zeros((count, 3))
        for bounce in range(bounces):
            t, triangle = self.hit(origin, direction)
            weight[~np.isfinite(t)] = 0
            place = origin + np.where(np.isfinite(t), t, 0)[:, None] * direction
            n = self.normal[triangle]
            weight[np.einsum("ra,ra->r", n, direction) > 0] = 0  # seen from behind: black
            weight = weight * self.albedo[triangle]
            if bounce > 0:
                total += weight * self.direct(place, n) / np.pi
            origin, direction = place + 1e-7 * n, self.scattered(n)
        return total


def closed_room() -> Scene:
    """A room with a box in it and a small lamp on its ceiling: 26 triangles."""
    lamp = quad((-0.4, 0.99, -0.4), (0.8, 0, 0), (0, 0, 0.8), 1, (10.0, 8.0, 5.0))  # faces down
    red = replace(quad((-0.99, -1, -1), (0, 2, 0), (0, 0, 2)), material=2)
    meshes = [box((1, 1, 1), inside=True), red, box((0.3, 0.4, 0.3), (0.3, -0.6, 0.2)), lamp]
    materials = (diffuse("grey", (0.6, 0.6, 0.6)), diffuse("lamp", (0.0, 0.0, 0.0)), diffuse("red", (0.7, 0.1, 0.1)))
    return replace(scene(meshes, view((-0.7, 0.4, -0.9), (0.2, -0.3, 0.3), 75, 24), (0, 0, 0)), materials=materials)


def test_indirect_light_is_the_path_tracers() -> None:
    what = closed_room()
    tracer = PathTracer(what, 1)
    paths = np.concatenate([tracer.indirect(4000, 14) for _ in range(10)])
    exact, error = paths.mean(axis=0), paths.std(axis=0) / np.sqrt(len(paths))
    assert np.all(error < 0.02 * exact)  # the oracle itself is sharp enough
    chosen = RenderSettings(photons=200_000, spp=8)
    seen = render_in_process(what, chosen, workers=1).layers["indirect"].astype(np.float64).mean(axis=(0, 1))
    # 13 bounces leave out 0.6^13 = 0.1 %. The map: a view of the room sees a good third of the 200,000 photons: 0.4
    # %, with the paths' correlation 0.6 %. What gathers blur over edges of shadows cancels in the mean but at
    # silhouettes: 1 %.
    tolerance = 4 * np.hypot(error, 0.006 * exact) + 0.01 * exact
    assert np.all(np.abs(seen - exact) < tolerance), (seen, exact, error)


@pytest.mark.parametrize("depth", [3, 4])
def test_depth_limits_cut_the_same_light_as_the_path_tracers(depth: int) -> None:
    """Light of paths of 3 edges was reflected twice, of 4 edges three times."""
    what = closed_room()
    tracer = PathTracer(what, 2)
    paths = np.concatenate([tracer.indirect(4000, depth - 1) for _ in range(8)])
    exact, error = paths.mean(axis=0), paths.std(axis=0) / np.sqrt(len(paths))
    chosen = RenderSettings(photons=100_000, spp=8, max_depth=depth)
    seen = render_in_process(what, chosen, workers=1).layers["indirect"].astype(np.float64).mean(axis=(0, 1))
    tolerance = 4 * np.hypot(error, 0.008 * exact) + 0.015 * exact
    assert np.all(np.abs(seen - exact) < tolerance), (seen, exact, error)


GLOW: RGB = (1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("closed", closed_room()),
        ("open", cornell_box((8, 8))),
        ("furnace", scene([hollow_sphere(True, GLOW)], view((0, 0, 0), (1, 0, 0), 60, 8), (0.9, 0.5, 0.1))),
        (
            "point in a box",
            scene(
                [box((1, 1, 1), inside=True)],
                view((0, 0, 0), (1, 0, 0), 60, 8),
                (0.9, 0.8, 0.7),
                (PointLight("p", (0.2, 0.3, -0.4), (1.0, 0.5, 0.0)),),
            ),
        ),
    ],
)
@pytest.mark.parametrize("max_depth", [None, 3, 6])
@pytest.mark.parametrize("workers", [1, 3])
def test_the_energy_ledger_closes(name: str, what: Scene, max_depth: int | None, workers: int) -> None:
    chosen = RenderSettings(photons=20_000, spp=1, max_depth=max_depth)
    report = render_in_process(what, chosen, workers=workers).metadata["report"]
    energy = EnergyLedger(**report["energy"])
    # Every flux is a float32 and every difference of two is exact in double or rounded by 2^-53: what is missing
    # comes from rounding a flux once a bounce, 2^-24 of it, with either sign.
    assert energy.imbalance < 1e-5
    assert energy.emitted > 0
    assert (energy.travelling > 0) == (max_depth is not None)
    if name != "open":
        # Nothing leaves a closed room, not one photon of 10^4 and more, through no edge or corner.
        assert energy.escaped == 0.0
    else:
        assert energy.escaped > 0.01 * energy.emitted


def test_emitted_power_is_the_lights() -> None:
    """A lamp of radiance L and area A emits pi L A, a point of intensity I 4 pi I; the report says so by light."""
    lamp = quad((-0.4, 0.99, -0.4), (0.8, 0, 0), (0, 0, 0.8), 0, (10.0, 8.0, 3.0))
    point = PointLight("p", (0.0, 0.0, 0.0), (1.0, 2.0, 3.0))
    what = scene([box((1, 1, 1), inside=True), lamp], view((0, 0, 0), (1, 0, 0), 60, 8), (0.5,) * 3, (point,))
    report = render_in_process(what, RenderSettings(photons=5000, spp=1), workers=1).metadata["report"]
    powers = [np.pi * 7.0 * 0.64, 4 * np.pi * 2.0]
    np.testing.assert_allclose([light["flux"] for light in report["photons"]["lights"]], powers, rtol=1e-6)
    # An element is chosen in proportion to its mean power, and its photons carry its colour: the mean over RGB is the
    # same for all photons, so the emitted power is exact but for roundings.
    np.testing.assert_allclose(EnergyLedger(**report["energy"]).emitted, sum(powers), rtol=1e-5)
