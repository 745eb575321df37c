"""Frames of materials at a point: along tangents where these tell, bent by maps, and bent as in Mitsuba."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from material_probe import Found, Wide, flat, image, probe, random_points

from wdpm.scenes.model.bsdfs import Bsdf, BumpMap, Conductor, Diffuse, NormalMap, Plastic, Principled, TwoSided
from wdpm.scenes.model.textures import Bitmap


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


@pytest.mark.parametrize("along_v", [-1.0, 0.0, 1.0])
@pytest.mark.parametrize("falls", [False, True])
def test_green_leans_along_v_where_it_is_told_to(falls: bool, along_v: float) -> None:
    """Left of where u grows, which is where v grows unless the texture is mirrored, if nothing is said."""
    dp_dv = (0.3, -1.0 if falls else 1.0, 0.0)
    bsdf = NormalMap(Diffuse(), flat((0.6, 0.8, 0.9)), along_v=along_v)
    (normal,) = probe([bsdf], dp_dv=dp_dv, towards=(0.0, 0.0, 1.0)).resolved["n"]
    leans = {0.0: 1.0, 1.0: np.sign(dp_dv[1]), -1.0: -np.sign(dp_dv[1])}[along_v]
    expected = np.array([0.2, 0.6 * leans, 0.8])
    np.testing.assert_allclose(normal, expected / np.linalg.norm(expected), atol=1e-6)


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
