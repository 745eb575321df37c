"""The light tree: its shape, its bounds against brute force, and the walks in it against their probabilities."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest
import warp as wp
from light_rig import QUAD, Array, Glow, Ways, direct, irradiance, numbers, square, table_of, without_power
from numpy.typing import NDArray

from wdpm.kernels.features import Features
from wdpm.kernels.lights import lights
from wdpm.kernels.lights.choice import chance_of_light, choose_light, light_starts
from wdpm.kernels.lights.elements import Lights
from wdpm.kernels.lights.tree import EVEN
from wdpm.scenes.flat.light_table import LightTable
from wdpm.scenes.flat.light_tree import HEADS, LightTree, build_light_tree
from wdpm.scenes.model.lights import DirectionalLight, Environment, Light, PointLight, SpotLight
from wdpm.scenes.model.transforms import look_at

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Standard errors that a count or a mean may be off by: a probability below 1e-6; seeds are fixed.
ERRORS = 5.0

SUN = DirectionalLight("sun", (0.6, 0.0, -0.8), (0.3, 0.2, 0.1))
SKY = Environment("sky", np.full((1, 1, 3), 0.02, np.float32))


def globe(center: tuple[float, float, float], radius: float, side: int = 6) -> Glow:
    """A sphere of radiance 1 that shines outwards."""
    theta, phi = np.linspace(0, np.pi, side + 1), np.linspace(0, 2 * np.pi, 2 * side, endpoint=False)
    ring = np.stack([np.cos(phi), np.sin(phi)], axis=1)
    place = np.stack([np.concatenate([ring * np.sin(t), np.full((2 * side, 1), np.cos(t))], axis=1) for t in theta])
    after = np.roll(place, -1, axis=1)
    upper = np.stack([place[:-1], place[1:], after[1:]], axis=2)[:-1]  # none at the lower pole
    lower = np.stack([place[:-1], after[1:], after[:-1]], axis=2)[1:]
    corners = np.concatenate([upper.reshape(-1, 3, 3), lower.reshape(-1, 3, 3)])
    return Glow((corners * radius + np.array(center)).astype(np.float32), (1.0, 1.0, 1.0))


def soup(count: int, seed: int) -> Glow:
    """Triangles anywhere, any way round."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-3, 3, (count, 1, 3)) + rng.normal(0, 0.3, (count, 3, 3))
    return Glow(corners.astype(np.float32), (1.0, 0.5, 0.2))


def spot(seed: int, cutoff: float) -> SpotLight:
    at = np.random.default_rng(seed).uniform(-4, 4, 3)
    return SpotLight(f"spot {seed}", look_at(at, (0, 0.1, 0), (0, 1, 0.2)), (2.0, 3.0, 1.0), cutoff, cutoff / 2)


def lamps(count: int) -> list[Light]:
    rng = np.random.default_rng(5)
    places = rng.uniform(-5, 5, (count, 3))
    return [PointLight(f"{i}", tuple(p), (10.0 ** rng.uniform(-2, 1),) * 3) for i, p in enumerate(places)]


def tables() -> dict[str, LightTable]:
    return {
        "globe": table_of([globe((0, 0, 2), 1.0)]),
        "soup": table_of([soup(300, 1)]),
        "spots": table_of(others=[spot(i, c) for i, c in enumerate([5.0, 20.0, 60.0, 89.0, 130.0] * 4)]),
        "a thousand": table_of(others=lamps(1000)),
        "all": table_of(
            [globe((0, 0, 2), 0.5), soup(40, 2), square(3.0, 2.0)], [*lamps(9), spot(3, 30.0), spot(4, 70.0), SUN, SKY]
        ),
        "distant": table_of(others=[SUN, SKY]),
        "one quadrilateral": table_of([square(2.0, 3.0)]),
        "two in one place": table_of(others=[PointLight(str(i), (0, 0, 1), (1.0 + i,) * 3) for i in range(2)]),
    }


TABLES = tables()
EVERY = pytest.mark.parametrize("name", TABLES)


@functools.cache
def _kernels() -> tuple[wp.Kernel, wp.Kernel]:
    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def chances(lights: Lights, place: wp.array[wp.vec3], chance: wp.array2d[wp.float32]):
        i, element = wp.tid()
        chance[i, element] = chance_of_light(lights, element, place[i]).probability

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def walks(
        lights: Lights,
        place: wp.array[wp.vec3],
        u: wp.array[wp.float64],
        across: wp.float64,
        element: wp.array[wp.int32],
        chance: wp.array[wp.float32],
    ):
        i = wp.tid()
        starts = light_starts(lights, place[i])
        c = choose_light(lights, place[i], starts, wp.vec2d(u[i], across))
        element[i] = c.element
        chance[i] = c.probability

    return chances, walks


def chances(table: LightTable, places: Array) -> Array:
    """Probability of each element for each place, shape [places, elements]."""
    out = wp.zeros((len(places), len(table.power)), dtype=wp.float32, device="cpu")
    place = wp.array(places.astype(np.float32), dtype=wp.vec3, device="cpu")
    wp.launch(_kernels()[0], out.shape, inputs=[lights.upload(table, 10.0, "cpu"), place, out], device="cpu")
    return out.numpy().astype(np.float64)


def walks(table: LightTable, places: Array, u: Array) -> tuple[NDArray[np.int32], Array]:
    """The element chosen for each place with each number, and its probability."""
    element = wp.zeros(len(u), dtype=wp.int32, device="cpu")
    chance = wp.zeros(len(u), dtype=wp.float32, device="cpu")
    inputs = [
        lights.upload(table, 10.0, "cpu"),
        wp.array(places.astype(np.float32), dtype=wp.vec3, device="cpu"),
        wp.array(u, dtype=wp.float64, device="cpu"),
        0.5,
    ]
    wp.launch(_kernels()[1], len(u), inputs=[*inputs, element, chance], device="cpu")
    return element.numpy(), chance.numpy().astype(np.float64)


def somewhere(count: int, seed: int) -> Array:
    return np.random.default_rng(seed).uniform(-5, 5, (count, 3))


def leaves_below(tree: LightTree, node: int) -> list[int]:
    child = int(tree.child[node])
    return [node] if child < 0 else leaves_below(tree, child) + leaves_below(tree, child + 1)


@EVERY
def test_the_tree_holds_each_element_once_and_bounds_it(name: str) -> None:
    table = TABLES[name]
    tree = build_light_tree(table)
    near = len(table.prim) + table.near
    held = [e for node in np.flatnonzero(tree.child < 0) for e in {int(tree.first[node]), int(tree.last[node])}]
    assert sorted(held) == list(range(near))  # all have power
    assert sorted(leaf for head in tree.heads for leaf in leaves_below(tree, int(head))) == sorted(
        np.flatnonzero(tree.child < 0)
    )
    assert len(tree.heads) == min(HEADS, len(tree.child) // 2 + 1 if len(tree.child) else 0)
    triangles = len(table.prim)
    normals = np.cross(table.corners[:, 1] - table.corners[:, 0], table.corners[:, 2] - table.corners[:, 0])
    for node in range(len(tree.child)):
        below = leaves_below(tree, node)
        elements = [e for leaf in below for e in {int(tree.first[leaf]), int(tree.last[leaf])}]
        np.testing.assert_allclose(tree.strength[node], tree.strength[below].sum(), rtol=1e-12)
        for element in elements:
            if element < triangles:
                at, axis = table.corners[element], normals[element] / np.linalg.norm(normals[element])
            elif table.delta_kind[element - triangles] == PointLight.KIND.number:
                at, axis = table.delta_position[element - triangles][None], None
            else:
                number = element - triangles
                assert table.delta_kind[number] == SpotLight.KIND.number
                at, axis = table.delta_position[number][None], table.delta_axes[number, 2]
                if table.delta_cutoff[number] > 0:
                    assert tree.cos_reach[node] <= table.delta_cutoff[number]
            assert np.all(np.linalg.norm(at - tree.center[node], axis=1) <= tree.radius[node] + 1e-6)
            if axis is None:
                assert tree.cos_axes[node] == -1.0
            else:
                assert axis @ tree.axis[node] >= tree.cos_axes[node] - 1e-5


def test_leaves_are_flat_quadrilaterals_where_they_can_be() -> None:
    """A square is one leaf; halves of two squares, or of a bent one, are not."""
    assert len(build_light_tree(table_of([square(2.0, 3.0)])).child) == 1
    assert len(build_light_tree(table_of([square(2.0, 3.0), square(3.0, 3.0)])).child) == 3
    bent = QUAD.copy()
    bent[1, 2, 2] = 0.1
    assert len(build_light_tree(table_of([Glow(bent, (1.0, 1.0, 1.0))])).child) == 3
    apart = QUAD.copy()
    apart[1, :, 0] += 5
    assert len(build_light_tree(table_of([Glow(apart, (1.0, 1.0, 1.0))])).child) == 3
    dark = without_power(table_of([square(2.0, 3.0)]), [1])
    tree = build_light_tree(dark)
    np.testing.assert_array_equal(tree.leaf, [0, -1])


@EVERY
def test_the_tree_is_the_same_when_built_again(name: str) -> None:
    one, other = build_light_tree(TABLES[name]), build_light_tree(TABLES[name])
    for field in vars(one):
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field), err_msg=field)


@EVERY
def test_chances_add_up_to_one(name: str) -> None:
    """To less only where a walk may end among nodes that all look away: what is missing was chosen for nothing."""
    table = TABLES[name]
    places = somewhere(200, 3)
    total = chances(table, places).sum(axis=1)
    assert total.max() < 1 + 1e-4
    lost = np.zeros(len(places))
    for i, place in enumerate(places):
        u = (np.arange(1000) + 0.5) / 1000
        lost[i] = (walks(table, np.broadcast_to(place, (1000, 3)), u)[0] < 0).mean()
    np.testing.assert_allclose(total, 1 - lost, atol=2e-2)
    if name in ("a thousand", "distant", "one quadrilateral", "two in one place"):
        np.testing.assert_allclose(total, 1.0, rtol=1e-5)


@EVERY
def test_a_walk_has_the_chance_that_it_says(name: str) -> None:
    """What the walk gives is what the climb gives; chi-square of the counts, from one place."""
    table = TABLES[name]
    count = 1 << 15
    rng = np.random.default_rng(4)
    places = somewhere(64, 5).repeat(count // 64, axis=0)
    element, chance = walks(table, places, rng.random(count))
    found = element >= 0
    assert found.any()
    by_climb = chances(table, places[:: count // 64]).repeat(count // 64, axis=0)[np.arange(count), element]
    np.testing.assert_allclose(chance[found], by_climb[found], rtol=1e-4)
    np.testing.assert_array_equal(chance[~found], 0.0)
    place = np.array([0.4, -0.3, 0.2])
    expected = chances(table, place[None])[0] * count
    element, _ = walks(table, np.broadcast_to(place, (count, 3)), rng.random(count))
    counts = np.bincount(element[element >= 0], minlength=len(expected))
    often = expected > 8
    variance = expected[often] * (1 - expected[often] / count)
    degrees = often.sum()
    if degrees > 1:
        chi2 = ((counts - expected)[often] ** 2 / np.maximum(variance, 1e-3)).sum()
        assert (chi2 - degrees) / math.sqrt(2 * degrees) < ERRORS
    rest = expected[~often].sum()
    assert abs(counts[~often].sum() - rest) <= ERRORS * math.sqrt(rest) + 1


def sent_by_triangles(table: LightTable, place: Array) -> Array:
    """Whether each triangle sees the place from its front by more than rounding."""
    p = table.corners.astype(np.float64)
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.asarray(((place - p[:, 0]) * normal).sum(axis=1) > 1e-5)


@pytest.mark.parametrize("name", ["globe", "soup", "spots", "all"])
def test_all_that_shines_may_be_chosen(name: str) -> None:
    """By brute force: each element that sends light to a place has a chance there; most that do not, have none."""
    table = TABLES[name]
    places = somewhere(300, 6)
    chance = chances(table, places)
    triangles, spots = len(table.prim), np.flatnonzero(table.delta_kind == SpotLight.KIND.number)
    dark, idle = 0, 0
    for place, own in zip(places, chance, strict=True):
        shines = np.ones(len(own), np.bool_)
        shines[:triangles] = sent_by_triangles(table, place)
        way = place - table.delta_position[spots]
        cosine = (way * table.delta_axes[spots, 2]).sum(axis=1) / np.linalg.norm(way, axis=1)
        shines[triangles + spots] = cosine > table.delta_cutoff[spots]
        assert np.all(own[shines] > 0)
        dark += (~shines).sum()
        idle += (own[~shines] == 0).sum()
    assert idle > 0.5 * dark


@pytest.mark.parametrize("name", ["globe", "soup", "spots", "a thousand", "all"])
def test_the_estimate_has_no_bias(name: str) -> None:
    """Irradiance by the tree against the sum over all elements, each chosen alone."""
    table = TABLES[name]
    place = (0.4, -0.3, 0.2)
    mean, error = irradiance(direct(table, place, 1 << 16, seed=3))
    if name == "a thousand":
        way = table.delta_position - np.array(place)
        distance = np.linalg.norm(way, axis=1)
        sent = table.delta_color * (np.maximum(way[:, 2], 0) / distance**3)[:, None]
        expected, own = sent.sum(axis=0, dtype=np.float64), np.zeros(3)
    else:
        samples = 512
        parts = [alone(table, element, place, samples) for element in range(len(table.power))]
        expected = np.sum([part[0] for part in parts], axis=0)
        own = np.sqrt(np.sum([part[1] ** 2 for part in parts], axis=0))
    assert np.all(np.abs(mean - expected) < ERRORS * np.hypot(error, own) + 1e-5 * expected)
    # A triangle a sixth of its size away makes the soup's 0.03, which was 0.14 with a choice by power.
    assert np.all(error < 0.05 * expected)


def alone(table: LightTable, element: int, place: tuple[float, float, float], count: int) -> tuple[Array, Array]:
    others = [e for e in range(len(table.power)) if e != element]
    return irradiance(direct(without_power(table, others), place, count, seed=element))


def test_the_tree_is_worth_its_while() -> None:
    """Second moments of an estimate, against those of a choice by power alone, worked out from the chances."""
    table = TABLES["a thousand"]
    places = somewhere(50, 9)
    share = table.power / table.power.sum()
    chance = chances(table, places)
    ratios = []
    for place, own in zip(places, chance, strict=True):
        sent = table.delta_color[:, 0] / ((table.delta_position - place) ** 2).sum(axis=1)
        ratios.append((sent**2 / own).sum() / (sent**2 / share).sum())
    assert np.median(ratios) < 0.4


def test_a_lamp_of_many_triangles_is_sampled_where_it_is_seen() -> None:
    """Half of a globe looks away, and few samples fall there."""
    ways = direct(table_of([globe((0, 0, 2), 1.0, side=24)]), (0.0, 0.0, 0.0), 4096)
    assert (ways.pdf > 0).mean() > 0.75
    mean, error = irradiance(ways)
    np.testing.assert_allclose(mean, math.pi / 4, rtol=0.03)  # pi sin² of its half angle; facets cut off 1 %
    assert np.all(error < 0.02 * mean)  # by area alone: 0.041


def test_lights_far_away_have_their_share() -> None:
    """The sky's chance falls as a lamp comes near."""
    table = table_of([square(2.0, 0.5, (5.0, 5.0, 5.0))], [SUN, SKY])
    places = np.array([[0, 0, -4.0], [0, 0, 0], [0, 0, 1.5]])
    far = chances(table, places)[:, 2:].sum(axis=1)
    assert np.all(np.diff(far) < 0)
    assert far[0] > 0.5
    assert far[2] > 0.0


def test_none_that_may_shine_is_forgotten_for_being_weak() -> None:
    """What stands in between is not known: next to a lamp 1e12 times as strong, a weak one keeps its even share."""
    strong, weak = PointLight("strong", (2.0, 0, 0), (1.0,) * 3), PointLight("weak", (-2.0, 0, 0), (1e-12,) * 3)
    found = chances(table_of(others=[strong, weak]), somewhere(100, 3))
    np.testing.assert_allclose(found[:, 1], float(EVEN) / 2, rtol=1e-6)
    found = chances(table_of(others=[strong, weak, SUN]), somewhere(100, 3))
    assert (found[:, 1] > 0.999 * float(EVEN) / 3).all()
    behind = table_of([square(2.0, 3.0)], [PointLight("weak", (0, 0, 1), (1e-12,) * 3)])
    above = np.array([[0.3, 0.2, 9.0]])  # where the square sends nothing: it gets no share at all
    np.testing.assert_allclose(chances(behind, above)[0, -1], 1.0, rtol=1e-6)


PRUNED = {
    "globe": Features(),
    "a thousand": Features(points=True),
    "spots": Features(spots=True),
    "distant": Features(directionals=True, environment=True),
}


@pytest.mark.parametrize("name", PRUNED)
def test_kernels_of_fewer_features_give_the_same_bits(name: str) -> None:
    places = numbers(2048, 3, 3) * 4 - 2
    one, other = (direct(TABLES[name], places, 2048, **kind) for kind in ({"features": PRUNED[name]}, {}))
    for field in Ways.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field), err_msg=field)
