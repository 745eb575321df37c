"""Materials at a point: every kind of node and leaf against values worked out by hand, and what a scene calls for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from material_probe import UP, flat, image, leaf, probe, random_points

from wdpm.kernels.features import ALL, Features
from wdpm.scenes.errors import SceneError
from wdpm.scenes.flat import material_table as mt
from wdpm.scenes.flat.material_coats import with_coats
from wdpm.scenes.flat.material_facts import facts
from wdpm.scenes.flat.material_table import tabulate
from wdpm.scenes.flat.plastic_coat import coat
from wdpm.scenes.model.bsdfs import (
    Blend,
    Bsdf,
    BumpMap,
    Conductor,
    Dielectric,
    Diffuse,
    Distribution,
    Mask,
    NormalMap,
    Null,
    Plastic,
    Principled,
    ThinDielectric,
    TwoSided,
)
from wdpm.scenes.model.textures import Checkerboard, Texture, VertexColors

LUMINANCE = np.array([0.212671, 0.715160, 0.072169])

DIFFUSE = Diffuse.KIND.number
CONDUCTOR = Conductor.KIND.number
DIELECTRIC = Dielectric.KIND.number
THIN_DIELECTRIC = ThinDielectric.KIND.number
PLASTIC = Plastic.KIND.number
PRINCIPLED = Principled.KIND.number
NULL = Null.KIND.number


# Leaves


def test_diffuse() -> None:
    b = leaf(Diffuse((0.1, 0.2, 0.3)))
    assert b["kind"] == DIFFUSE
    np.testing.assert_array_equal(b["color"], np.float32([0.1, 0.2, 0.3]))


def test_conductor() -> None:
    b = leaf(Conductor((0.1, 0.2, 0.3), (2.0, 3.0, 4.0), (0.9, 0.8, 0.7), 0.1, 0.4, Distribution.GGX))
    assert (b["kind"], b["distribution"]) == (CONDUCTOR, 1)
    for name, value in (
        ("eta", (0.1, 0.2, 0.3)),
        ("k", (2, 3, 4)),
        ("specular", (0.9, 0.8, 0.7)),
        ("alpha", (0.1, 0.4)),
    ):
        np.testing.assert_array_equal(b[name], np.float32(value))


def test_dielectrics() -> None:
    for bsdf, kind in (
        (Dielectric(1.7, (0.9, 0.8, 0.7), (0.6, 0.5, 0.4), 0.2, 0.3), DIELECTRIC),
        (ThinDielectric(1.7, (0.9, 0.8, 0.7), (0.6, 0.5, 0.4)), THIN_DIELECTRIC),
    ):
        b = leaf(bsdf)
        assert (b["kind"], b["distribution"], b["eta"][0]) == (kind, 0, np.float32(1.7))
        np.testing.assert_array_equal(b["specular"], np.float32([0.9, 0.8, 0.7]))
        np.testing.assert_array_equal(b["transmittance"], np.float32([0.6, 0.5, 0.4]))
        np.testing.assert_array_equal(b["alpha"], np.float32([0.2, 0.3] if kind == DIELECTRIC else [0, 0]))


@pytest.mark.parametrize("alpha", [0.0, 0.3])
@pytest.mark.parametrize("distribution", list(Distribution))
def test_plastic_with_its_coat(alpha: float, distribution: Distribution) -> None:
    b = leaf(Plastic((0.1, 0.2, 0.3), (0.9, 0.8, 0.7), 1.5, True, alpha, distribution))
    expected = coat(1.5, float(np.float32(alpha)), distribution)
    assert (b["kind"], b["nonlinear"]) == (PLASTIC, 1)
    assert b["distribution"] == int(distribution is Distribution.GGX)
    np.testing.assert_array_equal(b["color"], np.float32([0.1, 0.2, 0.3]))
    np.testing.assert_array_equal(b["specular"], np.float32([0.9, 0.8, 0.7]))
    np.testing.assert_array_equal(b["alpha"], np.float32([alpha, alpha]))
    np.testing.assert_allclose(b["eta"][:2], [1.5, expected.internal_reflectance], rtol=1e-6)
    np.testing.assert_allclose([*b["transmittance"], *b["k"]], expected.coefficients, rtol=1e-6)
    assert np.any(b["k"] != 0) == (alpha > 0)


def test_coats_that_are_there_stay() -> None:
    table, _ = tabulate([(Plastic(alpha=0.2), -2, -2), (Diffuse(), -2, -2)])
    once = with_coats(table)
    assert not (once.value == table.value).all()
    assert with_coats(once) is once
    changed = once.value.copy()
    changed[0, 8, 0] = 0.25
    kept = with_coats(mt.MaterialTable(once.kind, once.child, once.distribution, changed, once.texture, once.medium))
    assert kept.value[0, 8, 0] == 0.25


def test_principled() -> None:
    names = ("metallic", "spec_trans", "spec_tint", "sheen", "sheen_tint", "flatness", "clearcoat", "clearcoat_gloss")
    values = {name: 0.1 + 0.05 * i for i, name in enumerate(names)}
    b = leaf(Principled((0.1, 0.2, 0.3), 0.6, 0.7, eta=1.4, **values))
    assert b["kind"] == PRINCIPLED
    np.testing.assert_array_equal(b["color"], np.float32([0.1, 0.2, 0.3]))
    assert (b["eta"][0], b["roughness"]) == (np.float32(1.4), np.float32(0.6))
    for name, value in values.items():
        assert b[name] == np.float32(value), name
    aspect = np.sqrt(1 - 0.9 * 0.7)
    np.testing.assert_allclose(b["alpha"], [0.36 / aspect, 0.36 * aspect], rtol=1e-6)
    np.testing.assert_array_equal(leaf(Principled(roughness=0.01))["alpha"], np.float32([1e-3, 1e-3]))
    assert (b["layered"], leaf(Principled(layered=True))["layered"]) == (0.0, 1.0)


def test_textured_parameters() -> None:
    """Colours are multiplied by channel, numbers by luminance; each kind of texture."""
    red = (0.8, 0.2, 0.4)
    checker = Checkerboard("board", red, (0.0, 0.0, 0.0))
    paint = VertexColors("paint", 2.0)
    at = {"uv": (0.1, 0.2), "color": (0.3, 0.2, 0.1)}
    y = float(LUMINANCE @ red)
    for source, colour in ((flat(red), red), (checker, red), (paint, (0.6, 0.4, 0.2))):
        np.testing.assert_allclose(leaf(Diffuse(source), **at)["color"], colour, rtol=1e-6)
        b = leaf(Principled(source, source, metallic=source), **at)
        np.testing.assert_allclose(b["color"], colour, rtol=1e-6)
        assert b["roughness"] == pytest.approx(LUMINANCE @ colour, rel=1e-6)
        assert b["metallic"] == pytest.approx(LUMINANCE @ colour, rel=1e-6)
    b = leaf(Conductor(flat(red), checker, flat(red), flat(red), 0.25), **at)
    for name in ("eta", "k", "specular"):
        np.testing.assert_allclose(b[name], red, rtol=1e-6)
    np.testing.assert_allclose(b["alpha"], [y, 0.25], rtol=1e-6)
    b = leaf(Plastic(flat(red), checker), **at)
    np.testing.assert_allclose(b["color"], red, rtol=1e-6)
    np.testing.assert_allclose(b["specular"], red, rtol=1e-6)
    assert leaf(Diffuse(checker), uv=(0.1, 0.7))["color"].max() == 0.0


# Nodes


def test_two_sided() -> None:
    sides = TwoSided(Diffuse((0.1, 0.1, 0.1)), Conductor())
    same = TwoSided(Diffuse((0.2, 0.2, 0.2)))
    plain = Diffuse((0.3, 0.3, 0.3))
    found = probe([sides, same, plain], root=[0, 1, 2, 0, 1, 2], front=[1, 1, 1, 0, 0, 0])
    assert found.kind.tolist() == [
        DIFFUSE,
        DIFFUSE,
        DIFFUSE,
        CONDUCTOR,
        DIFFUSE,
        DIFFUSE,
    ]
    assert found.resolved["flipped"].tolist() == [0, 0, 0, 1, 1, 0]
    np.testing.assert_array_equal(found.resolved["n"][:, 2], [1, 1, 1, -1, -1, 1])
    assert not found.resolved["passes"].any()


def test_sides_inside_sides_are_seen_from_their_front() -> None:
    inner = TwoSided(Diffuse((0.5, 0.0, 0.0)), Diffuse((0.0, 0.5, 0.0)))
    found = probe([TwoSided(Diffuse((0.0, 0.0, 0.5)), inner)], front=[1, 0])
    np.testing.assert_array_equal(found.resolved["bsdf"]["color"], [[0, 0, 0.5], [0.5, 0, 0]])


def test_mask_and_blend_divide_the_numbers() -> None:
    """Every leaf gets its share of stratified numbers, and what each is left with is uniform again."""
    count = 1 << 14
    u = (np.arange(count) + 0.5) / count
    inner = Blend(Diffuse((0.0, 0.0, 0.0)), Diffuse((1.0, 0.0, 0.0)), 0.25)
    other = Blend(Diffuse((0.0, 1.0, 0.0)), Mask(Diffuse((0.0, 0.0, 1.0)), 0.375), 0.5)
    found = probe([Mask(Blend(inner, other, 0.3), 0.8)], u_choice=u)
    b = found.resolved["bsdf"]
    diffuse = found.kind == DIFFUSE
    shares = {
        "first": np.mean(diffuse & (b["color"] == 0).all(axis=1)),
        "red": np.mean(b["color"][:, 0] == 1),
        "green": np.mean(b["color"][:, 1] == 1),
        "blue": np.mean(b["color"][:, 2] == 1),
        "hole": np.mean(found.kind == NULL),
    }
    expected = {
        "first": 0.8 * 0.7 * 0.75,
        "red": 0.8 * 0.7 * 0.25,
        "green": 0.8 * 0.3 * 0.5,
        "blue": 0.8 * 0.3 * 0.5 * 0.375,
        "hole": 0.2 + 0.8 * 0.3 * 0.5 * 0.625,
    }
    for name, share in expected.items():
        assert shares[name] == pytest.approx(share, abs=3 / count), name
    np.testing.assert_array_equal(found.resolved["passes"], found.kind == NULL)
    np.testing.assert_allclose(found.opacity, 1 - expected["hole"], rtol=1e-6)
    np.testing.assert_allclose(found.straight, np.full((count, 3), expected["hole"]), rtol=1e-6)


def test_shares_at_their_ends() -> None:
    """Weights and opacities of 0 and 1, and beyond them, choose one side whatever the number."""
    u = np.array([0.0, 1e-30, 0.5, 1 - 2.0**-24])
    black, white = Diffuse((0.0, 0.0, 0.0)), Diffuse((1.0, 1.0, 1.0))
    for weight, colour in ((0.0, 0), (-1.0, 0), (1.0, 1), (3.0, 1)):
        assert (probe([Blend(black, white, weight)], u_choice=u).resolved["bsdf"]["color"] == colour).all()
    for opacity, kind in (
        (0.0, NULL),
        (-1.0, NULL),
        (1.0, DIFFUSE),
        (2.0, DIFFUSE),
    ):
        found = probe([Mask(white, opacity)], u_choice=u)
        assert (found.kind == kind).all()
        assert (found.opacity == float(kind == DIFFUSE)).all()


def test_textured_shares() -> None:
    u = (np.arange(4096) + 0.5) / 4096
    grey = flat((0.3, 0.3, 0.3))
    found = probe([Mask(Diffuse(), grey), Blend(Diffuse((0.0, 0.0, 0.0)), Diffuse(), grey)], u_choice=u)
    assert np.mean(found.kind == DIFFUSE) == pytest.approx(0.3, abs=1e-3)
    assert found.opacity[0] == pytest.approx(0.3, abs=1e-6)
    found = probe([Blend(Diffuse((0.0, 0.0, 0.0)), Diffuse(), grey)], u_choice=u)
    assert np.mean(found.resolved["bsdf"]["color"][:, 0] > 0) == pytest.approx(0.3, abs=1e-3)


def test_straight_light() -> None:
    """Of each material by itself; a blend of two passing ones; what only reflects stops all."""
    pane = ThinDielectric(1.5, specular_transmittance=(1.0, 0.5, 0.25))
    r = ((1.5 - 1) / (1.5 + 1)) ** 2
    through = (1 - 2 * r / (1 + r)) * np.array([1.0, 0.5, 0.25])
    cases: list[tuple[Bsdf, Any, float]] = [
        (Diffuse(), 0.0, 1.0),
        (Dielectric(), 0.0, 1.0),
        (TwoSided(Plastic()), 0.0, 1.0),
        (Null(), 1.0, 0.0),
        (pane, through, 1.0),
        (Mask(Diffuse(), 0.25), 0.75, 0.25),
        (Mask(pane, 0.25), 0.75 + 0.25 * through, 0.25),
        (Blend(pane, Null(), 0.25), 0.75 * through + 0.25, 0.75),
        (Blend(Diffuse(), Mask(pane, 0.5), 0.4), 0.4 * (0.5 + 0.5 * through), 0.8),
        (TwoSided(Mask(Diffuse(), 0.25)), 0.75, 0.25),
        (BumpMap(Mask(Diffuse(), 0.25), image(1)), 0.75, 0.25),
    ]
    bsdfs = [bsdf for bsdf, _, _ in cases]
    found = probe(bsdfs, root=np.arange(len(bsdfs)), towards=UP)
    for i, (bsdf, straight, opacity) in enumerate(cases):
        np.testing.assert_allclose(found.straight[i], np.broadcast_to(straight, 3), rtol=2e-6, err_msg=repr(bsdf))
        assert found.opacity[i] == pytest.approx(opacity, abs=1e-6)


def test_media() -> None:
    for media, front, beyond in (((3, -1), 1, 3), ((3, -1), 0, -1), ((-1, 2), 0, 2)):
        assert probe([Diffuse()], media=media, front=front).beyond[0] == beyond
    assert probe([Diffuse()], front=[0, 1]).beyond.tolist() == [7, 7]


# What a scene calls for


FAMILIES: list[tuple[list[Bsdf], Features]] = [
    ([Diffuse((0.1, 0.2, 0.3)), TwoSided(Diffuse()), TwoSided(Diffuse(), Diffuse((0.0, 0.0, 0.0)))], Features()),
    ([Diffuse(image(40)), TwoSided(Diffuse(image(41)))], Features(bitmaps=True)),
    (
        [Diffuse(Checkerboard("board")), Diffuse(VertexColors("paint"))],
        Features(checkerboards=True, vertex_colors=True),
    ),
    ([Diffuse(), Mask(TwoSided(Diffuse()), image(42)), Null()], Features(passing=True, bitmaps=True)),
    ([Diffuse(), ThinDielectric()], Features(passing=True, thin_dielectric=True)),
    ([Diffuse(), Blend(Diffuse((0.1, 0.1, 0.1)), Conductor(), 0.3)], Features(blend=True, conductor=True)),
    (
        [
            Conductor(alpha_u=0.1, alpha_v=0.3),
            TwoSided(Conductor(alpha_u=image(43))),
            Dielectric(alpha_u=0.2, alpha_v=0.2),
        ],
        Features(conductor=True, dielectric=True, rough=True, bitmaps=True),
    ),
    ([Plastic(), TwoSided(Plastic(alpha=0.2, nonlinear=True))], Features(plastic=True, rough=True)),
    ([Principled(), TwoSided(Principled(image(44), 0.3, 0.6))], Features(principled=True, bitmaps=True)),
    (
        [TwoSided(BumpMap(Diffuse(), image(45))), NormalMap(Diffuse(image(46)), image(47)), Diffuse()],
        Features(bent=True, bitmaps=True),
    ),
]


@pytest.mark.parametrize(("bsdfs", "features"), FAMILIES, ids=[str(i) for i in range(len(FAMILIES))])
def test_specialised_kernels_give_the_same_bits(bsdfs: list[Bsdf], features: Features) -> None:
    rng = np.random.default_rng(50)
    points: dict[str, Any] = random_points(51, 300, smooth=True)
    points |= {
        "root": np.arange(300) % len(bsdfs),
        "front": rng.integers(0, 2, 300),
        "u_choice": rng.random(300) * 0.999,
        "color": rng.random((300, 3)),
    }
    every = probe(bsdfs, ALL, **points)
    assert probe(bsdfs, features, **points).bytes() == every.bytes()
    assert np.unique(every.resolved["n"], axis=0).shape[0] > 200


@pytest.mark.parametrize(("bsdfs", "features"), FAMILIES, ids=[str(i) for i in range(len(FAMILIES))])
def test_facts_name_the_features(bsdfs: list[Bsdf], features: Features) -> None:
    table, textures = tabulate([(bsdf, -2, -2) for bsdf in bsdfs])
    found = facts(table, textures)
    assert len(found) == len(bsdfs)
    assert frozenset().union(*(fact.features for fact in found)) == set(features.names())
    assert any(fact.glossy for fact in found) == features.glossy


def test_facts_of_each_material() -> None:
    bsdfs: list[Bsdf] = [
        Diffuse(),
        Diffuse((0.0, 0.0, 0.0)),
        Mask(TwoSided(Blend(Diffuse(), Conductor(alpha_u=0.1))), 0.5),
        Principled(metallic=1.0),
        Principled(spec_trans=0.5),
        Dielectric(),
        Null(),
    ]
    table, textures = tabulate([(bsdf, -2, -2) for bsdf in bsdfs])
    found = facts(table, textures)
    assert [fact.diffuse for fact in found] == [True, False, True, False, True, False, False]
    assert [fact.transmits for fact in found] == [False, False, True, False, True, True, True]
    assert [fact.calls_for("passing") for fact in found] == [False, False, True, False, False, False, True]
    assert [fact.calls_for("rough") for fact in found] == [False, False, True, False, False, False, False]
    assert [fact.glossy for fact in found] == [False, False, True, True, True, True, False]


def nested(depth: int) -> Bsdf:
    bsdf: Bsdf = Diffuse()
    for _ in range(depth):
        bsdf = Mask(bsdf, 0.99)
    return bsdf


def test_depth_of_nesting() -> None:
    assert probe([Diffuse(), nested(16)], root=1, u_choice=0.0).kind[0] == DIFFUSE
    with pytest.raises(SceneError, match="17 materials are nested"):
        probe([Diffuse(), nested(17)])


def test_sides_that_pass_light_differently_are_refused() -> None:
    with pytest.raises(SceneError, match="material 1: the two sides"):
        probe([Diffuse(), TwoSided(Diffuse(), Mask(Diffuse(), 0.5))])


def test_bumps_need_an_image() -> None:
    heights: Texture = VertexColors("height")
    table, textures = tabulate([(BumpMap(Diffuse(), heights), -2, -2)])
    with pytest.raises(SceneError, match='"height"'):
        facts(table, textures)


def test_a_cutoff_makes_holes_of_what_is_less_opaque() -> None:
    """For paths, shadow rays and the layer of opacity alike, between texels as well."""
    uv = np.random.default_rng(5).uniform(0.0, 1.0, (200, 2))
    soft = probe([Mask(Diffuse(), image(51))], uv=uv).opacity
    cut = probe([Mask(Diffuse(), image(51), cutoff=0.5)], uv=uv, u_choice=0.999)
    assert 0.2 < (soft >= 0.5).mean() < 0.8
    np.testing.assert_array_equal(cut.opacity, soft >= 0.5)
    np.testing.assert_array_equal(cut.straight[:, 0], soft < 0.5)
    np.testing.assert_array_equal(cut.resolved["passes"], soft < 0.5)
