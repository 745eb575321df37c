"""Materials at a point: every kind of node and leaf against values worked out by hand, and Mitsuba's bent frames."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels import materials as kernel_materials
from wdpm.kernels import texture
from wdpm.kernels.features import ALL, Features
from wdpm.kernels.materials import Materials, Resolved, make_materials, medium_beyond
from wdpm.kernels.shading_frames import bump_shadowing
from wdpm.kernels.texture import Textures
from wdpm.scenes import material_table as mt
from wdpm.scenes.bsdfs import (
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
from wdpm.scenes.errors import SceneError
from wdpm.scenes.material_coats import with_coats
from wdpm.scenes.material_facts import facts
from wdpm.scenes.material_table import tabulate
from wdpm.scenes.plastic_coat import coat
from wdpm.scenes.textures import Bitmap, Checkerboard, Texture, VertexColors

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Floats = NDArray[np.float32]
Wide = NDArray[np.float64]

LUMINANCE = np.array([0.212671, 0.715160, 0.072169])


@functools.cache
def make_probe(features: Features) -> wp.Kernel:
    functions = make_materials(features)
    resolve = functions.resolve
    straight_transmittance = functions.straight_transmittance
    opacity_at = functions.opacity_at

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def probe(
        materials: Materials,
        textures: Textures,
        root: wp.array[wp.int32],
        uv: wp.array[wp.vec2],
        color: wp.array[wp.vec3],
        dp_du: wp.array[wp.vec3],
        dp_dv: wp.array[wp.vec3],
        normal: wp.array[wp.vec3],
        front: wp.array[wp.int32],
        u_choice: wp.array[wp.float32],
        towards: wp.array[wp.vec3],
        to_light: wp.array[wp.vec3],
        resolved_out: wp.array[Resolved],
        straight_out: wp.array[wp.vec3],
        opacity_out: wp.array[wp.float32],
        beyond_out: wp.array[wp.int32],
        lit_out: wp.array[wp.float32],
    ):
        i = wp.tid()
        r = resolve(
            materials,
            textures,
            root[i],
            uv[i],
            color[i],
            dp_du[i],
            dp_dv[i],
            normal[i],
            front[i] == 1,
            u_choice[i],
            towards[i],
        )
        resolved_out[i] = r
        cos_theta = wp.abs(wp.dot(normal[i], towards[i]))
        straight_out[i] = straight_transmittance(materials, textures, root[i], uv[i], color[i], cos_theta)
        opacity_out[i] = opacity_at(materials, textures, root[i], uv[i], color[i])
        beyond_out[i] = medium_beyond(materials, root[i], front[i], 7)
        lit_out[i] = bump_shadowing(r.bumps2, wp.dot(r.unbent, to_light[i]))

    return probe


@dataclass(frozen=True, eq=False)
class Found:
    """What kernels say of points.

    Attributes:
        resolved: a record array with the fields of Resolved.
        straight, opacity, beyond: of straight_transmittance, opacity_at and medium_beyond (from medium 7).
        lit: bump_shadowing.
    """

    resolved: NDArray[Any]
    straight: Floats
    opacity: Floats
    beyond: NDArray[np.int32]
    lit: Floats

    @property
    def kind(self) -> NDArray[np.int32]:
        return np.asarray(self.resolved["bsdf"]["kind"])

    def bytes(self) -> tuple[bytes, ...]:
        return tuple(np.ascontiguousarray(a).tobytes() for a in (self.resolved, self.straight, self.opacity, self.lit))


UP = np.array([0.0, 0.0, 1.0])


def probe(
    bsdfs: list[Bsdf], features: Features = ALL, media: tuple[int, int] = (mt.SAME_MEDIUM, mt.SAME_MEDIUM), **given: Any
) -> Found:
    """Points of materials; what is not given is a point with z up, seen from above. Arrays of different lengths fit."""
    points: dict[str, Any] = {
        "root": 0,
        "uv": (0.3, 0.4),
        "color": (1.0, 1.0, 1.0),
        "dp_du": (1.0, 0.0, 0.0),
        "dp_dv": (0.0, 1.0, 0.0),
        "normal": UP,
        "front": 1,
        "u_choice": 0.5,
        "towards": (0.48, 0.0, 0.8772684879784524),
        "to_light": UP,
    } | given
    kinds: dict[str, Any] = {"root": wp.int32, "front": wp.int32, "u_choice": wp.float32, "uv": wp.vec2}
    table, textures = tabulate([(bsdf, *media) for bsdf in bsdfs])
    widths = {name: 0 if kinds.get(name) in (wp.int32, wp.float32) else 2 if name == "uv" else 3 for name in points}
    count = max(np.size(values) // max(widths[name], 1) for name, values in points.items())
    inputs = [kernel_materials.upload(table, "cpu"), texture.upload(textures, "cpu")]
    for name, values in points.items():
        shape = (count, widths[name]) if widths[name] else (count,)
        whole = np.ascontiguousarray(np.broadcast_to(np.asarray(values), shape))
        kind = kinds.get(name, wp.vec3)
        inputs.append(wp.array(whole.astype(np.int32 if kind is wp.int32 else np.float32), dtype=kind, device="cpu"))
    out = [wp.empty(count, dtype=kind, device="cpu") for kind in (Resolved, wp.vec3, wp.float32, wp.int32, wp.float32)]
    wp.launch(make_probe(features), count, inputs=inputs, outputs=out, device="cpu")
    return Found(*(array.numpy() for array in out))


def leaf(bsdf: Bsdf, **given: Any) -> Any:
    """The leaf that a material of one point resolves to, as a record."""
    return probe([bsdf], **given).resolved["bsdf"][0]


def image(seed: int, height: int = 4, width: int = 4) -> Bitmap:
    pixels = np.random.default_rng(seed).uniform(0.05, 0.95, (height, width, 3)).astype(np.float32)
    return Bitmap(f"image {seed}", pixels)


def flat(colour: Any) -> Bitmap:
    """An image of one colour."""
    return Bitmap("flat", np.tile(np.asarray(colour, np.float32), (2, 2, 1)))


# Leaves


def test_diffuse() -> None:
    b = leaf(Diffuse((0.1, 0.2, 0.3)))
    assert b["kind"] == mt.DIFFUSE
    np.testing.assert_array_equal(b["color"], np.float32([0.1, 0.2, 0.3]))


def test_conductor() -> None:
    b = leaf(Conductor((0.1, 0.2, 0.3), (2.0, 3.0, 4.0), (0.9, 0.8, 0.7), 0.1, 0.4, Distribution.GGX))
    assert (b["kind"], b["distribution"]) == (mt.CONDUCTOR, 1)
    for name, value in (
        ("eta", (0.1, 0.2, 0.3)),
        ("k", (2, 3, 4)),
        ("specular", (0.9, 0.8, 0.7)),
        ("alpha", (0.1, 0.4)),
    ):
        np.testing.assert_array_equal(b[name], np.float32(value))


def test_dielectrics() -> None:
    for bsdf, kind in (
        (Dielectric(1.7, (0.9, 0.8, 0.7), (0.6, 0.5, 0.4), 0.2, 0.3), mt.DIELECTRIC),
        (ThinDielectric(1.7, (0.9, 0.8, 0.7), (0.6, 0.5, 0.4)), mt.THIN_DIELECTRIC),
    ):
        b = leaf(bsdf)
        assert (b["kind"], b["distribution"], b["eta"][0]) == (kind, 0, np.float32(1.7))
        np.testing.assert_array_equal(b["specular"], np.float32([0.9, 0.8, 0.7]))
        np.testing.assert_array_equal(b["transmittance"], np.float32([0.6, 0.5, 0.4]))
        np.testing.assert_array_equal(b["alpha"], np.float32([0.2, 0.3] if kind == mt.DIELECTRIC else [0, 0]))


@pytest.mark.parametrize("alpha", [0.0, 0.3])
@pytest.mark.parametrize("distribution", list(Distribution))
def test_plastic_with_its_coat(alpha: float, distribution: Distribution) -> None:
    b = leaf(Plastic((0.1, 0.2, 0.3), (0.9, 0.8, 0.7), 1.5, True, alpha, distribution))
    expected = coat(1.5, float(np.float32(alpha)), distribution)
    assert (b["kind"], b["nonlinear"]) == (mt.PLASTIC, 1)
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
    assert b["kind"] == mt.PRINCIPLED
    np.testing.assert_array_equal(b["color"], np.float32([0.1, 0.2, 0.3]))
    assert (b["eta"][0], b["roughness"]) == (np.float32(1.4), np.float32(0.6))
    for name, value in values.items():
        assert b[name] == np.float32(value), name
    aspect = np.sqrt(1 - 0.9 * 0.7)
    np.testing.assert_allclose(b["alpha"], [0.36 / aspect, 0.36 * aspect], rtol=1e-6)
    np.testing.assert_array_equal(leaf(Principled(roughness=0.01))["alpha"], np.float32([1e-3, 1e-3]))


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
    assert found.kind.tolist() == [mt.DIFFUSE, mt.DIFFUSE, mt.DIFFUSE, mt.CONDUCTOR, mt.DIFFUSE, mt.DIFFUSE]
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
    diffuse = found.kind == mt.DIFFUSE
    shares = {
        "first": np.mean(diffuse & (b["color"] == 0).all(axis=1)),
        "red": np.mean(b["color"][:, 0] == 1),
        "green": np.mean(b["color"][:, 1] == 1),
        "blue": np.mean(b["color"][:, 2] == 1),
        "hole": np.mean(found.kind == mt.NULL),
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
    np.testing.assert_array_equal(found.resolved["passes"], found.kind == mt.NULL)
    np.testing.assert_allclose(found.opacity, 1 - expected["hole"], rtol=1e-6)
    np.testing.assert_allclose(found.straight, np.full((count, 3), expected["hole"]), rtol=1e-6)


def test_shares_at_their_ends() -> None:
    """Weights and opacities of 0 and 1, and beyond them, choose one side whatever the number."""
    u = np.array([0.0, 1e-30, 0.5, 1 - 2.0**-24])
    black, white = Diffuse((0.0, 0.0, 0.0)), Diffuse((1.0, 1.0, 1.0))
    for weight, colour in ((0.0, 0), (-1.0, 0), (1.0, 1), (3.0, 1)):
        assert (probe([Blend(black, white, weight)], u_choice=u).resolved["bsdf"]["color"] == colour).all()
    for opacity, kind in ((0.0, mt.NULL), (-1.0, mt.NULL), (1.0, mt.DIFFUSE), (2.0, mt.DIFFUSE)):
        found = probe([Mask(white, opacity)], u_choice=u)
        assert (found.kind == kind).all()
        assert (found.opacity == float(kind == mt.DIFFUSE)).all()


def test_textured_shares() -> None:
    u = (np.arange(4096) + 0.5) / 4096
    grey = flat((0.3, 0.3, 0.3))
    found = probe([Mask(Diffuse(), grey), Blend(Diffuse((0.0, 0.0, 0.0)), Diffuse(), grey)], u_choice=u)
    assert np.mean(found.kind == mt.DIFFUSE) == pytest.approx(0.3, abs=1e-3)
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


# Frames


def random_points(seed: int, count: int, smooth: bool) -> dict[str, Wide]:
    """Points with tangents that are skew, of any length, of either orientation; smooth ones not across the normal."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    tangents = rng.normal(size=(2, count, 3)) * rng.uniform(0.5, 2, (2, count, 1))
    slant = 0.3 if smooth else 1.0
    tangents -= slant * normal * np.sum(normal * tangents, axis=2, keepdims=True)
    towards, light = normal + 0.5 * rng.normal(size=(2, count, 3))
    side = np.where(rng.random(count) < 0.5, 1.0, -1.0)[:, None]
    towards, light = (
        v - normal * np.minimum(np.sum(normal * v, axis=1, keepdims=True) - 0.05, 0) for v in (towards, light)
    )
    towards, light = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (towards, light))
    return {
        "normal": normal,
        "dp_du": tangents[0],
        "dp_dv": tangents[1] * side,
        "uv": rng.uniform(-1, 2, (count, 2)),
        "towards": towards,
        "to_light": light,
    }


def check_orthonormal(found: Found, tolerance: float = 2e-6) -> None:
    axes = np.stack([found.resolved[name] for name in "stn"], axis=1).astype(np.float64)
    np.testing.assert_allclose(axes @ axes.transpose(0, 2, 1), np.broadcast_to(np.eye(3), axes.shape), atol=tolerance)


def test_frames_follow_u_only_where_it_can_be_told() -> None:
    points = random_points(1, 200, smooth=True)
    brushed = probe([Conductor(alpha_u=0.1, alpha_v=0.3)], **points)
    check_orthonormal(brushed)
    along = points["dp_du"] - points["normal"] * np.sum(points["normal"] * points["dp_du"], axis=1, keepdims=True)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    np.testing.assert_allclose(brushed.resolved["s"], along, atol=2e-6)
    assert (np.linalg.det(np.stack([brushed.resolved[name] for name in "stn"], axis=1)) > 0).all()
    no_uv = {**points, "dp_du": np.zeros(3), "dp_dv": np.zeros(3)}
    for bsdf in (Diffuse(), Conductor(alpha_u=0.2, alpha_v=0.2), Principled(), TwoSided(Plastic())):
        assert probe([bsdf], **points).bytes() == probe([bsdf], **no_uv).bytes()
    check_orthonormal(probe([Diffuse()], **points))


def test_frames_without_usable_tangents() -> None:
    normal = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.6, 0.0, -0.8], [1.0, 0.0, 0.0]])
    for tangent in (np.zeros(3), normal, normal * 1e-20, normal * 1e10):
        for bsdf in (Conductor(alpha_u=0.1, alpha_v=0.3), BumpMap(Diffuse(), image(2)), NormalMap(Diffuse(), image(3))):
            check_orthonormal(probe([bsdf], normal=normal, dp_du=tangent, dp_dv=tangent, towards=normal))


def test_the_back_is_the_mirror_image_of_the_front() -> None:
    """Local coordinates mean the same on both sides: only the part along the normal changes its sign."""
    points = random_points(4, 100, smooth=True)
    normal = points["normal"].astype(np.float32)
    mirror = np.eye(3) - 2 * normal[:, :, None] * normal[:, None, :]
    behind = {**points, "towards": np.einsum("nij,nj->ni", mirror, points["towards"])}
    for bsdf in (Conductor(alpha_u=0.1, alpha_v=0.3), BumpMap(Diffuse(), image(5)), NormalMap(Diffuse(), image(6))):
        front = probe([TwoSided(bsdf)], **points, front=1).resolved
        back = probe([TwoSided(bsdf)], **behind, front=0).resolved
        for name in "stn":
            np.testing.assert_allclose(back[name], np.einsum("nij,nj->ni", mirror, front[name]), atol=3e-6)
        np.testing.assert_array_equal(back["unbent"], -normal)
        np.testing.assert_allclose(back["bumps2"], front["bumps2"], rtol=2e-5, atol=1e-6)


def test_a_flat_normal_map_changes_nothing_else() -> None:
    points = random_points(7, 50, smooth=False)
    found = probe([NormalMap(Diffuse(), flat((0.5, 0.5, 1.0)))], **points)
    np.testing.assert_allclose(found.resolved["n"], points["normal"], atol=1e-6)
    np.testing.assert_allclose(found.resolved["bumps2"], 0.0, atol=1e-6)
    np.testing.assert_allclose(found.lit, 1.0, atol=1e-6)


def test_normals_of_no_length_bend_nothing() -> None:
    points = random_points(8, 50, smooth=False)
    found = probe([NormalMap(Diffuse(), flat((0.5, 0.5, 0.5)))], **points)
    np.testing.assert_array_equal(found.resolved["n"], points["normal"].astype(np.float32))
    check_orthonormal(found)


def test_unbent_materials_are_not_shadowed_by_bumps() -> None:
    found = probe(
        [Diffuse(), Conductor(alpha_u=0.1, alpha_v=0.2)], root=[0, 1] * 50, **random_points(9, 100, smooth=True)
    )
    assert (found.lit == 1.0).all()
    assert (found.resolved["bumps2"] == 0.0).all()


# Mitsuba


@pytest.fixture(scope="module")
def mi() -> Any:
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    return mitsuba


def mitsuba_image(mi: Any, bitmap: Bitmap) -> Any:
    """The same image in Mitsuba, whose v runs downwards."""
    pixels = mi.Bitmap(np.ascontiguousarray(bitmap.pixels[::-1]))
    return {"type": "bitmap", "bitmap": pixels, "raw": True}


def mitsuba_point(mi: Any, points: dict[str, Wide], i: int) -> tuple[Any, Wide]:
    """A point of Mitsuba's, and its axes as rows."""
    n, du = points["normal"][i], points["dp_du"][i]
    s = du - n * (n @ du)
    s /= np.linalg.norm(s)
    axes = np.stack([s, np.cross(n, s), n])
    si = mi.SurfaceInteraction3f()
    si.t = 1.0
    si.sh_frame = mi.Frame3f(*(mi.Vector3f(axis) for axis in axes))
    si.n = mi.Normal3f(n)
    si.dp_du, si.dp_dv = mi.Vector3f(du), mi.Vector3f(points["dp_dv"][i])
    si.uv = mi.Point2f(points["uv"][i])
    si.wi = mi.Vector3f(axes @ points["towards"][i])
    return si, axes


def compare_bending(
    mi: Any, ours: Bsdf, theirs: dict[str, Any], inner: dict[str, Any], points: dict[str, Wide]
) -> None:
    """Mitsuba's value of a bent material is that of the nested one in our frame, times the shadowing of bumps."""
    bent, nested = mi.load_dict(theirs), mi.load_dict(inner)
    found = probe([ours], **points)
    check_orthonormal(found)
    context = mi.BSDFContext()
    wanted, got = [], []
    for i in range(len(points["normal"])):
        si, axes = mitsuba_point(mi, points, i)
        to_light = points["to_light"][i]
        wanted.append(float(bent.eval(context, si, mi.Vector3f(axes @ to_light))[0]))
        frame = np.stack([found.resolved[name][i] for name in "stn"]).astype(np.float64)
        inside = mi.SurfaceInteraction3f(si)
        inside.wi = mi.Vector3f(frame @ points["towards"][i])
        value = float(nested.eval(context, inside, mi.Vector3f(frame @ to_light))[0])
        got.append(value * float(found.lit[i]))
    np.testing.assert_allclose(got, wanted, rtol=2e-3, atol=2e-5)
    assert np.mean(np.array(wanted) > 1e-3) > 0.5


DIFFUSE_THERE = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}}
BRUSHED_THERE = {"type": "roughconductor", "material": "none", "alpha_u": 0.3, "alpha_v": 0.6, "distribution": "ggx"}
ROUGH_THERE = {"type": "roughconductor", "material": "none", "alpha": 0.4, "distribution": "ggx"}


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("inner", [DIFFUSE_THERE, BRUSHED_THERE], ids=["diffuse", "brushed"])
def test_normal_maps_bend_as_in_mitsuba(mi: Any, inner: dict[str, Any], smooth: bool) -> None:
    """Steep ones too, which Mitsuba turns around where they face away from the viewer."""
    pixels = np.random.default_rng(30).uniform(0.1, 0.9, (4, 5, 3)).astype(np.float32)
    pixels[:, :, 2] = 0.5 + 0.4 * pixels[:, :, 2]
    normals = Bitmap("normals", pixels)
    nested = Diffuse() if inner is DIFFUSE_THERE else Conductor(alpha_u=0.3, alpha_v=0.6)
    theirs = {"type": "normalmap", "normalmap": mitsuba_image(mi, normals), "nested": inner}
    compare_bending(mi, NormalMap(nested, normals), theirs, inner, random_points(31, 150, smooth))


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("inner", [DIFFUSE_THERE, ROUGH_THERE], ids=["diffuse", "rough"])
def test_bump_maps_bend_as_in_mitsuba(mi: Any, inner: dict[str, Any], smooth: bool) -> None:
    """Of a material that looks alike along all tangents: Mitsuba's bump maps turn these by the world's axes."""
    heights = image(32, 3, 5)
    nested = Diffuse() if inner is DIFFUSE_THERE else Conductor(alpha_u=0.4, alpha_v=0.4)
    theirs = {"type": "bumpmap", "texture": mitsuba_image(mi, heights), "scale": 0.3, "nested": inner}
    compare_bending(mi, BumpMap(nested, heights, 0.3), theirs, inner, random_points(33, 150, smooth))


def test_two_sided_bumps_as_in_mitsuba(mi: Any) -> None:
    """Seen from behind. Mitsuba's two-sided material mirrors directions, then asks the nested one."""
    heights = image(34, 4, 3)
    points = random_points(35, 100, smooth=False)
    behind = {**points, "towards": -points["towards"], "to_light": -points["to_light"], "front": np.zeros(100)}
    theirs = mi.load_dict(
        {
            "type": "twosided",
            "nested": {"type": "bumpmap", "texture": mitsuba_image(mi, heights), "scale": 0.3, "nested": DIFFUSE_THERE},
        }
    )
    found = probe([TwoSided(BumpMap(Diffuse(), heights, 0.3))], **behind)
    got, wanted = [], []
    for i in range(100):
        si, axes = mitsuba_point(mi, behind, i)
        wanted.append(float(theirs.eval(mi.BSDFContext(), si, mi.Vector3f(axes @ behind["to_light"][i]))[0]))
        n = found.resolved["n"][i].astype(np.float64)
        seen = n @ behind["towards"][i] > 0
        got.append(0.5 / np.pi * max(0.0, n @ behind["to_light"][i]) * float(found.lit[i]) * seen)
    np.testing.assert_allclose(got, wanted, rtol=2e-3, atol=2e-5)
    assert np.mean(np.array(wanted) > 1e-3) > 0.5


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
    for name in (field for field in vars(found[0]) if hasattr(features, field)):
        assert any(getattr(fact, name) for fact in found) == getattr(features, name), name
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
    assert [fact.passing for fact in found] == [False, False, True, False, False, False, True]
    assert [fact.rough for fact in found] == [False, False, True, False, False, False, False]
    assert [fact.glossy for fact in found] == [False, False, True, True, True, True, False]


def nested(depth: int) -> Bsdf:
    bsdf: Bsdf = Diffuse()
    for _ in range(depth):
        bsdf = Mask(bsdf, 0.99)
    return bsdf


def test_depth_of_nesting() -> None:
    assert probe([Diffuse(), nested(16)], root=1, u_choice=0.0).kind[0] == mt.DIFFUSE
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
