"""Parts of the add-on that need no Blender."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wdpm.blender import layers, progress
from wdpm.blender.export import lights
from wdpm.blender.export.camera import image_size, pixel_filter, render_region
from wdpm.blender.export.meshes import _welded
from wdpm.blender.export.pixel_nodes import PIXEL_NODES, unsupported_mode
from wdpm.blender.export.principled import base_share, read_principled
from wdpm.blender.export.shaders import Shaders, on_both_sides
from wdpm.blender.export.values import Value, constant
from wdpm.blender.export.world import TO_BLENDER, euler_matrix
from wdpm.scenes.meshes.backs import back_of, is_closed
from wdpm.scenes.meshes.primitives import cube, rectangle
from wdpm.scenes.model.bsdfs import Blend, Dielectric, Diffuse, Mask, NormalMap, Null, Principled, TwoSided
from wdpm.scenes.model.scene import Camera, FilterKind, Mesh
from wdpm.scenes.model.textures import Bitmap

RED, GREEN = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def seen(width: int = 4, height: int = 2, **how: Any) -> Camera:
    return Camera(np.eye(4), 90.0, width, height, **how)


class TestDepth:
    def test_of_a_plane_across_the_axis_is_the_same_everywhere(self) -> None:
        depth = layers.depth_of(seen())
        across = (np.arange(4) + 0.5) / 4 * 2 - 1
        down = ((np.arange(2) + 0.5) / 2 * 2 - 1) / 2
        distance = 3.0 * np.sqrt(1.0 + across[None, :] ** 2 + down[:, None] ** 2)
        np.testing.assert_allclose(depth.along_axis(distance.astype(np.float32)), 3.0, rtol=1e-6)

    def test_of_parallel_rays(self) -> None:
        camera = seen(orthographic=True)
        camera.to_world[:3, :2] *= 5.0
        across = ((np.arange(4) + 0.5) / 4 * 2 - 1) * 5.0
        down = ((np.arange(2) + 0.5) / 2 * 2 - 1) * 2.5
        distance = np.sqrt(9.0 + across[None, :] ** 2 + down[:, None] ** 2)
        np.testing.assert_allclose(layers.depth_of(camera).along_axis(distance.astype(np.float32)), 3.0, rtol=1e-5)

    def test_a_crop_has_that_of_its_part_of_the_whole(self) -> None:
        whole = layers.depth_of(seen(principal_point=(0.1, 0.2)))
        part = layers.depth_of(seen(2, 1, principal_point=(0.1, 0.2), crop=(1, 1, 2, 1), full_size=(4, 2)))
        np.testing.assert_array_equal(part.steepness, whole.part(1, 1, 2, 1).steepness)

    def test_where_nothing_is(self) -> None:
        assert (layers.depth_of(seen()).along_axis(np.zeros((2, 4), np.float32)) == layers.NOWHERE).all()


DEPTH = layers.depth_of(seen(2, 2))
OURS = {"beauty": np.arange(12, dtype=np.float32).reshape(2, 2, 3)}


class TestPasses:
    def test_the_lowest_row_comes_first_and_alpha_is_one(self) -> None:
        pixels = layers.pixels_of(layers.COMBINED, OURS, DEPTH).reshape(2, 2, 4)
        np.testing.assert_array_equal(pixels[0, :, :3], OURS["beauty"][1])
        assert (pixels[:, :, 3] == 1.0).all()

    def test_light_that_a_scene_has_none_of_is_black(self) -> None:
        caustic = next(each for each in layers.PASSES if each.name == "Caustic")
        assert not layers.pixels_of(caustic, OURS, DEPTH).any()

    def test_which_there_are(self) -> None:
        view = SimpleNamespace(use_pass_z=True, use_pass_normal=False, use_pass_diffuse_color=True)
        assert [each.name for each in layers.passes_of(view, False)] == ["Depth", "DiffCol"]
        assert len(list(layers.passes_of(view, True))) == 6


class TestCamera:
    def region(self, **how: Any) -> tuple[int, int, int, int]:
        size = {"resolution_x": 101, "resolution_y": 50, "resolution_percentage": 50, "use_border": False}
        return render_region(SimpleNamespace(**(size | how)))

    def test_percentages_cut_off(self) -> None:
        assert self.region() == (0, 0, 50, 25)
        assert image_size(SimpleNamespace(resolution_x=1, resolution_y=1, resolution_percentage=1)) == (1, 1)

    def test_a_region_counts_from_below(self) -> None:
        border = {"border_min_x": 0.1, "border_max_x": 0.5, "border_min_y": 0.2, "border_max_y": 1.0}
        assert self.region(use_border=True, **border) == (5, 5, 20, 20)

    def test_filters(self) -> None:
        assert pixel_filter(0.0).kind is FilterKind.BOX
        assert (pixel_filter(1.5).kind, pixel_filter(1.5).radius) == (FilterKind.GAUSSIAN, 0.75)


class TestWorld:
    @pytest.mark.parametrize("turn", range(8))
    def test_where_a_direction_is_looked_up(self, turn: int) -> None:
        angle = 0.3 + turn * math.pi / 4.0
        in_blender = np.array([math.cos(angle), math.sin(angle), 0.5])
        x, y, z = TO_BLENDER[:3, :3].T @ in_blender  # the environment's own axes
        ours = math.atan2(x, -z) / (2.0 * math.pi) % 1.0
        blenders = (0.5 - math.atan2(in_blender[1], in_blender[0]) / (2.0 * math.pi)) % 1.0
        assert ours == pytest.approx(blenders)
        assert y == in_blender[2]

    def test_angles_turn_about_x_first(self) -> None:
        turned = euler_matrix((math.pi / 2.0, 0.0, math.pi / 2.0)) @ np.array([0.0, 1.0, 0.0])
        np.testing.assert_allclose(turned, [0.0, 0.0, 1.0], atol=1e-15)


class TestLights:
    def test_what_is_in_view(self) -> None:
        ahead, aside, behind = (np.array([each]) for each in ([0.0, 0.0, 5.0], [9.0, 0.0, 5.0], [0.0, 0.0, -5.0]))
        assert [lights.in_view(seen(), each) for each in (ahead, aside, behind)] == [True, False, False]

    def test_a_cloud_has_its_middle_in_the_middle_and_its_spread(self) -> None:
        for places, square in (
            (lights.on_disk(64), 0.5),
            (lights.on_square(8), 2.0 / 3.0),
            (lights.on_sphere(64), 1.0),
        ):
            assert np.abs(places.mean(axis=0)).max() < 0.02
            assert (places**2).sum(axis=1).mean() == pytest.approx(square, rel=0.02)

    def test_an_area_of_spots_shines_as_bright_as_the_area(self) -> None:
        spots = lights._cosine_spots("Area", np.eye(4), lights.on_square(8), (2.0, 3.0, 4.0))
        on_axis = np.sum([spot.intensity for spot in spots], axis=0)
        within = math.sin(math.radians(lights.WIDEST_COSINE)) ** 2  # of the flux of a cosine
        np.testing.assert_allclose(on_axis * within, [2.0, 3.0, 4.0])
        pattern = spots[0].texture.pixels[:, :, 0]
        tangent = (255.5 / 256.0) * math.tan(math.radians(lights.WIDEST_COSINE))
        assert pattern[128, 255] == pytest.approx(math.cos(math.atan(tangent)), rel=0.01)
        assert {tuple(spot.to_world[:3, 2]) for spot in spots} == {(0.0, 0.0, -1.0)}

    def test_a_spots_edge_is_a_smoothstep_in_the_cosine(self) -> None:
        pixels = lights._soft_edge(1.0, math.cos(math.pi / 4), 1.0).pixels[:, :, 0]
        middle = lights.PATTERN // 2
        assert pixels[middle, middle] == pytest.approx(1.0, abs=1e-3)
        assert pixels[0, 0] == 0.0
        assert (np.diff(pixels[middle, middle:]) < 0).all()


class TestMeshes:
    def test_corners_that_are_alike_become_one_vertex(self) -> None:
        points = np.array([0, 1, 2, 0, 2, 3])
        first, faces = _welded(points, [np.zeros((6, 0)), np.array([[0.0]] * 5 + [[1.0]])])
        assert len(first) == 4
        np.testing.assert_array_equal(points[first][faces], points.reshape(2, 3))

    def test_a_seam_keeps_both_sides_apart(self) -> None:
        first, _ = _welded(np.array([0, 1, 2, 0, 2, 3]), [np.arange(6.0)[:, None]])
        assert len(first) == 6

    def test_what_is_closed(self) -> None:
        _, faces = np.unique(cube().vertices, axis=0, return_inverse=True)[0], cube().faces
        names = np.unique(cube().vertices, axis=0, return_inverse=True)[1].reshape(-1)
        assert is_closed(names[faces])
        assert not is_closed(rectangle().faces)

    def test_the_back_of_what_glows_lies_behind_it_and_faces_back(self) -> None:
        front = Mesh("lamp", rectangle().vertices, rectangle().faces, rectangle().normals, None, 0, (1.0, 1.0, 1.0))
        back = back_of(front)
        assert (back.vertices[:, 2] < 0).all()
        corners = back.vertices[back.faces[0]]
        assert np.cross(corners[1] - corners[0], corners[2] - corners[0])[2] < 0
        assert (back.normals[:, 2] == -1).all()


class TestMaterials:
    def test_blenders_base_is_darker_under_gloss(self) -> None:
        assert base_share(0.0, 1.0) == pytest.approx(1.0)  # no gloss, and all is Lambertian
        assert base_share(0.0, 1.5) < base_share(0.0, 1.2) < 1.0
        assert base_share(0.0, 1.5) < base_share(0.5, 1.5)  # rough gloss reflects less

    @pytest.mark.parametrize("sockets", [{"IOR": 1.0}, {"Specular IOR Level": 0.0}])
    def test_metals_reflect_whatever_their_index(self, sockets: dict[str, float]) -> None:
        """Of an index of 1 itself our Principled reflects nothing, metal or not."""
        plain = dict.fromkeys(("Alpha", "Specular Tint", "Metallic"), 1.0) | {"IOR": 1.5, "Specular IOR Level": 0.5}
        node = SimpleNamespace(has=lambda _: False, input=lambda name: (plain | sockets).get(name, 0.0))
        bsdf = read_principled(node, SimpleNamespace(read=constant)).bsdf  # type: ignore[arg-type]
        assert isinstance(bsdf, Principled)
        assert bsdf.metallic == 1.0
        assert 1.0 < bsdf.eta < 1.01

    def test_green_of_normal_maps_leans_to_where_v_grows(self) -> None:
        normals = Value(np.full((2, 2, 3), 0.5), image=Bitmap("bumps", np.zeros((2, 2, 3), np.float32)))
        given = {"Color": normals, "Strength": constant(1.0)}
        node = SimpleNamespace(space="TANGENT", bl_idname="ShaderNodeNormalMap")
        source = SimpleNamespace(kind=node.bl_idname, node=node, input=lambda name: given[name])
        surface = SimpleNamespace(has=lambda _: True, input=lambda _: SimpleNamespace(source=source))
        bent = Shaders(SimpleNamespace(read=lambda value: value)).bent(Diffuse(), surface)  # type: ignore[arg-type]
        assert isinstance(bent, NormalMap)
        assert bent.along_v == 1.0

    def test_surfaces_are_seen_from_both_sides(self) -> None:
        glass = Dielectric()
        assert isinstance(on_both_sides(Diffuse()), TwoSided)
        assert on_both_sides(glass) is glass
        mixed = on_both_sides(Blend(Diffuse(), glass, 0.5))
        assert isinstance(mixed.first, TwoSided)
        assert mixed.second is glass
        assert isinstance(on_both_sides(Mask(Diffuse(), 0.5)).nested, TwoSided)
        assert isinstance(on_both_sides(Null()), Null)


class TestNodes:
    def run(self, kind: str, *inputs: Any, output: str = "", **node: Any) -> Any:
        arrays = [np.full(3, each) if isinstance(each, float) else np.asarray(each) for each in inputs]
        return PIXEL_NODES[f"ShaderNode{kind}"](SimpleNamespace(bl_idname=f"ShaderNode{kind}", **node), output, arrays)

    @pytest.mark.parametrize(
        ("blend", "expected"),
        [("MIX", [0.5, 0.5, 0]), ("ADD", [1, 0.5, 0]), ("MULTIPLY", [0.5, 0, 0]), ("SUBTRACT", [1, -0.5, 0])],
    )
    def test_mix(self, blend: str, expected: list[float]) -> None:
        how = {"data_type": "RGBA", "blend_type": blend, "clamp_factor": True, "clamp_result": False}
        np.testing.assert_allclose(self.run("Mix", 0.5, RED, GREEN, **how), expected)

    def test_an_image_and_a_constant(self) -> None:
        image = np.linspace(0.0, 1.0, 12).reshape(2, 2, 3)
        how = {"operation": "MULTIPLY_ADD", "use_clamp": True}
        result = self.run("Math", image, 2.0, 0.5, **how)
        assert result.shape == (2, 2, 3)
        assert result.max() == 1.0

    def test_hue_turns_around(self) -> None:
        np.testing.assert_allclose(self.run("HueSaturation", 0.5 + 1 / 3, 1.0, 1.0, 1.0, RED), GREEN, atol=1e-9)

    def test_channels(self) -> None:
        np.testing.assert_array_equal(self.run("SeparateColor", GREEN, output="Green"), [1.0, 1.0, 1.0])
        np.testing.assert_array_equal(self.run("CombineColor", 1.0, 0.0, 0.0), RED)

    def test_map_range(self) -> None:
        how = {"interpolation_type": "LINEAR", "clamp": True}
        np.testing.assert_allclose(self.run("MapRange", 0.75, 0.5, 1.0, 10.0, 20.0, 4.0, **how), 15.0)
        np.testing.assert_allclose(self.run("MapRange", 7.0, 0.5, 0.5, 10.0, 20.0, 4.0, **how), 10.0)

    def test_what_a_node_may_be_set_to(self) -> None:
        assert unsupported_mode(SimpleNamespace(bl_idname="ShaderNodeMath", operation="SINE")) == "SINE"
        assert unsupported_mode(SimpleNamespace(bl_idname="ShaderNodeMath", operation="ADD")) is None
        assert unsupported_mode(SimpleNamespace(bl_idname="ShaderNodeSeparateColor", mode="HSV")) == "HSV"


class Engine:
    """What a render tells Blender."""

    def __init__(self) -> None:
        self.words: list[str] = []
        self.shares: list[float] = []
        self.stop = False

    def update_stats(self, _: str, text: str) -> None:
        self.words.append(text)

    def update_progress(self, share: float) -> None:
        self.shares.append(share)

    def test_break(self) -> bool:
        return self.stop


class TestProgress:
    def test_words_are_few_and_the_bar_never_falls(self, monkeypatch: pytest.MonkeyPatch) -> None:
        engine, now = Engine(), [0.0]
        monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
        told = progress.BlenderProgress(engine)
        told.start("compile")
        told.start("render", 100)
        for _ in range(100):
            now[0] += 0.1
            told.advance()
        told.start("render", 100)
        assert len(engine.words) < 25
        assert engine.words[0].startswith("Compiling")
        assert engine.shares == sorted(engine.shares)
        assert engine.shares[-1] > 0.9

    def test_esc_is_seen_at_once(self) -> None:
        engine = Engine()
        told = progress.BlenderProgress(engine)
        told.start("render", 100)
        engine.stop = True
        with pytest.raises(progress.Cancelled):
            told.advance()

    def test_a_time_is_its_own_measure(self, monkeypatch: pytest.MonkeyPatch) -> None:
        engine, now = Engine(), [0.0]
        monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
        told = progress.BlenderProgress(engine, seconds=10.0)
        now[0] = 5.0
        told.start("pilot")
        assert engine.shares == [0.5]

    def test_buckets_of_the_first_pass_are_shown_and_then_the_mean(self) -> None:
        shown: list[tuple[int, int]] = []
        display = progress.BlenderDisplay(lambda _, x, y: shown.append((x, y)))
        bucket: Any = SimpleNamespace(layers={}, x0=3, y0=4)
        for first_sample in (0, 16):
            display.begin(SimpleNamespace(first_sample=first_sample))  # type: ignore[arg-type]
            display.bucket(bucket)
        mean: Any = SimpleNamespace(layers=dict)
        display.pass_done(mean)
        display.pass_done(mean)  # too soon after the other
        assert shown == [(3, 4), (0, 0)]
