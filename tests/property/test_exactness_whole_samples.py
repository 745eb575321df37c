"""Samples and gather rays that one launch follows to their ends have the bits of those that travel as batches."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

import effect_scenes
import numpy as np
import pytest
from digests import alone, same_bits
from hypothesis import given, settings
from hypothesis import strategies as st
from random_scenes import scenes_with_effects

from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.work.whole.samples import WholeSamples
from wdpm.images.image import Image
from wdpm.kernels import columns
from wdpm.kernels.camera.pixel_filter import reach_of
from wdpm.kernels.camera.vertices import Shaded
from wdpm.kernels.features import ALL, Features
from wdpm.kernels.whole_samples.trace import make_trace_samples
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes import cornell_box
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Camera, FilterKind, Mesh, PixelFilter, Scene, diffuse

pytestmark = pytest.mark.own_kernels

PATH = RenderSettings(integrator=Integrator.PATH, spp=3, light_samples=2)
PHOTONS = replace(PATH, integrator=Integrator.PHOTONS, photons=1500, k=15, caustic_photons=700, caustic_k=12)
MAP, GATHER, CACHE = (
    replace(PHOTONS, indirect=indirect) for indirect in (Indirect.MAP, Indirect.GATHER, Indirect.CACHE)
)


def floor() -> Mesh:
    """A unit square at y = 0 that faces up."""
    corners = np.array([[-0.5, 0.0, -0.5], [-0.5, 0.0, 0.5], [0.5, 0.0, 0.5], [0.5, 0.0, -0.5]])
    return Mesh("floor", corners, np.array([[0, 1, 2], [0, 2, 3]]), None, None, 0)


def seen_by(**camera: object) -> Scene:
    scene = cornell_box((16, 12))
    return replace(scene, camera=replace(scene.camera, **camera))  # type: ignore[arg-type]


# Few, as each has kernels of its own compiled: with all effects, media among them, samples are not traced whole.
SCENES = {
    "diffuse": cornell_box((16, 12)),
    "metals": effect_scenes.metals(),
    "coats": effect_scenes.coats(),
    "panes": effect_scenes.panes(),
    "splats": seen_by(filter=PixelFilter(FilterKind.MITCHELL, 2.0)),
    "negative filter": seen_by(filter=PixelFilter(FilterKind.LANCZOS, 4.0)),
}


OF_RAYS = -1


@contextmanager
def counted(monkeypatch: pytest.MonkeyPatch, *, whole: bool) -> Iterator[list[int]]:
    """How many samples whole launches add, where there are any; of gather rays of records -1 a launch."""
    launched: list[int] = []
    trace, trace_rays = WholeSamples.trace, WholeSamples.trace_rays

    def remember(self: WholeSamples, pixels: object, start: int, samples: int, sums: object) -> object:
        launched.append(samples)
        return trace(self, pixels, start, samples, sums)  # type: ignore[arg-type]

    def remember_rays(self: WholeSamples, *rays: object) -> object:
        launched.append(OF_RAYS)
        return trace_rays(self, *rays)  # type: ignore[arg-type]

    with monkeypatch.context() as patch:
        patch.setattr(WholeSamples, "trace", remember)
        patch.setattr(WholeSamples, "trace_rays", remember_rays)
        if not whole:
            patch.setattr(WholeSamples, "can_be", False)
        yield launched


def by_batches(monkeypatch: pytest.MonkeyPatch, scene: Scene, chosen: RenderSettings) -> Image:
    """The image of a worker that follows no sample whole."""
    with counted(monkeypatch, whole=False) as launched:
        image = alone(scene, chosen)
    assert launched == []
    return image


def counted_of(image: Image) -> dict[str, object]:
    """What a report says of camera samples, times left out."""
    report = image.metadata["report"]
    names = ("vertices", "gathers", "gathers_truncated", "gathers_left_band", "nonfinite", "guards")
    gathers = {name: number for name, number in (report["final_gather"] or {}).items() if not name.endswith("_s")}
    return {name: report[name] for name in names} | gathers


@pytest.mark.parametrize(
    ("name", "chosen"),
    [
        *((name, replace(PATH, max_depth=4 if name == "panes" else None)) for name in SCENES),
        *((name, CACHE) for name in SCENES),
        *((name, GATHER) for name in ("metals", "coats", "panes")),
        ("metals", replace(GATHER, caustic_photons=0)),
        ("coats", replace(CACHE, max_depth=14)),  # what records read might be too many edges long for gather rays
        *((name, replace(way, max_depth=5)) for name in ("diffuse", "coats") for way in (GATHER, CACHE)),
        *((name, replace(MAP, max_depth=depth)) for name, depth in (("diffuse", None), ("coats", None), ("coats", 4))),
    ],
)
def test_the_same_bits(name: str, chosen: RenderSettings, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = by_batches(monkeypatch, SCENES[name], chosen)
    with counted(monkeypatch, whole=True) as launched:
        image = alone(SCENES[name], chosen)
    least = 1 if reach_of(SCENES[name].camera.filter) else chosen.spp  # what counts in several pixels is apart
    assert sum(samples for samples in launched if samples != OF_RAYS) >= least  # more on outlines of lamps
    gathered = image.metadata["report"]["final_gather"]
    assert (OF_RAYS in launched) == bool(gathered and gathered["record_rays"])
    assert image.digest() == expected.digest()
    assert counted_of(image) == counted_of(expected)
    assert all(expected.layers[layer].any() for layer in ("direct", "indirect"))


@pytest.mark.parametrize("way", [PATH, CACHE], ids=["path", "photons"])
@pytest.mark.parametrize("name", ["diffuse", "coats", "negative filter"])
def test_waves_buckets_threads_and_cells_change_no_bit(
    name: str, way: RenderSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = alone(SCENES[name], way)
    monkeypatch.setattr("wdpm.cluster.work.bucket_home.WAVE_SAMPLES", 50)
    monkeypatch.setattr("wdpm.cluster.work.records.record_home.WAVE_RAYS", 500)
    monkeypatch.setattr("wdpm.cluster.work.whole.samples.WHOLE_GRAIN", 8)
    for workers, cells, threads, bucket in ((1, 1, 3, 5), (3, 1, 1, 7), (2, 4, 2, 6)):
        chosen = replace(way, bucket=bucket)
        order = random.Random(bucket)
        image = render_in_process(
            SCENES[name],
            chosen,
            workers=workers,
            cells=cells,
            team=1 if cells == 1 else None,
            threads=threads,
            shuffle=order,
        )
        assert same_bits(image, expected)


def test_a_launch_has_room_for_one_vertex_however_many_samples_it_follows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Room for each pixel of all launches before was 2 GiB of a bucket of 512 x 512 pixels, with 16 threads."""
    made, empty_nested = [], columns.empty_nested

    def remember(struct: object, counts: Mapping[str, int], device: str) -> object:
        if struct is Shaded:
            made.append(max(counts.values()))
        return empty_nested(struct, counts, device)  # type: ignore[arg-type]

    with counted(monkeypatch, whole=True):
        monkeypatch.setattr("wdpm.cluster.work.whole.samples.WHOLE_GRAIN", 8)
        monkeypatch.setattr(columns, "empty_nested", remember)
        render_in_process(SCENES["diffuse"], PATH, workers=1, cells=1, threads=3)
    assert len(made) > 1
    assert set(made) == {PATH.light_samples}


def test_vertices_of_samples_that_are_rendered_again_count_once(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = by_batches(monkeypatch, SCENES["diffuse"], PATH)
    trace, calls = WholeSamples.trace, []

    def spoilt_at_last(self: WholeSamples, pixels: object, start: int, samples: int, sums: object) -> object:
        calls.append(samples)  # of pixels on outlines of lamps, which take more, or of the others
        return trace(self, pixels, start, samples, sums) if len(calls) == 1 else None  # type: ignore[arg-type]

    monkeypatch.setattr(WholeSamples, "trace", spoilt_at_last)
    image = alone(SCENES["diffuse"], PATH)
    assert len(calls) == 2
    assert image.digest() == expected.digest()
    assert image.metadata["report"]["vertices"] == expected.metadata["report"]["vertices"]


def test_rays_that_are_traced_again_are_traced_by_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was traced whole, and is spoilt, has left its hits with the rays: the others set out anew."""
    expected = by_batches(monkeypatch, SCENES["diffuse"], CACHE)
    trace_rays, calls = WholeSamples.trace_rays, []

    def spoilt_at_first(self: WholeSamples, *rays: object) -> object:
        traced = trace_rays(self, *rays)  # type: ignore[arg-type]
        calls.append(traced)
        return None if len(calls) == 1 else traced

    monkeypatch.setattr(WholeSamples, "trace_rays", spoilt_at_first)
    image = alone(SCENES["diffuse"], CACHE)
    assert len(calls) > 1
    assert image.digest() == expected.digest()
    assert counted_of(image) == counted_of(expected)


def test_what_guards_count_is_rendered_in_the_other_way(monkeypatch: pytest.MonkeyPatch) -> None:
    to_world = np.diag([-1.0, 1.0, -1.0, 1.0])  # looks along -z
    to_world[:3, 3] = (0.0, 0.05, 1.0)
    star = PointLight("star", (0.0, 0.3, 0.0), (5e37, 5e37, 5e37))  # right above it light overflows
    white = diffuse("white", (0.9, 0.9, 0.9), twosided=True)
    scene = Scene("too bright", (floor(),), (white,), (star,), Camera(to_world, fov_x=40.0, width=12, height=8))
    expected = by_batches(monkeypatch, scene, PATH)
    image = alone(scene, PATH)
    assert image.metadata["report"]["nonfinite"] == expected.metadata["report"]["nonfinite"] != {}
    assert image.digest() == expected.digest()


def settings_of_all_ways(**more: st.SearchStrategy[object]) -> st.SearchStrategy[RenderSettings]:
    """Settings for scenes with any effects.

    Args:
        more: what else is chosen, by name.
    """
    return st.builds(
        lambda way, **changes: replace(way, all_effects=True, **changes),
        way=st.sampled_from([PATH, MAP, GATHER, CACHE]),
        seed=st.integers(0, 2**32 - 1),
        max_depth=st.sampled_from([None, None, 1, 2, 4]),
        light_samples=st.sampled_from([1, 4]),
        passes=st.sampled_from([1, 2]),
        **more,
    )


@settings(max_examples=20, deadline=None, derandomize=True)
@given(
    scene=scenes_with_effects(),
    chosen=settings_of_all_ways(),
    wave=st.sampled_from([7, 50, 1 << 16]),
    bright=st.booleans(),
)
def test_random_scenes_of_all_effects_but_media(scene: Scene, chosen: RenderSettings, wave: int, bright: bool) -> None:
    """By kernels for all effects, but for the one that follows samples, which is for all of those that it knows."""
    scene = without_media(scene)
    if bright and chosen.integrator == PATH.integrator:  # some of its light overflows; photons of it are refused
        star = PointLight("star", (0.3, 0.2, -0.9), (5e37, 2e37, 5e37))
        scene = replace(scene, lights=(*scene.lights, star))
    with pytest.MonkeyPatch.context() as patch:
        expected = by_batches(patch, scene, chosen)
        patch.setattr(Replica, "_choose_kernels", choose_kernels_that_follow_samples)
        patch.setattr("wdpm.cluster.work.bucket_home.WAVE_SAMPLES", wave)
        patch.setattr("wdpm.cluster.work.whole.samples.WHOLE_GRAIN", 8)
        with counted(patch, whole=True) as launched:
            image = render_in_process(scene, replace(chosen, bucket=8), workers=1, cells=1, threads=3)
    assert launched
    assert image.digest() == expected.digest()
    if not reach_of(scene.camera.filter):  # else pixels that two buckets need count twice
        assert counted_of(image) == counted_of(expected)


def without_media(scene: Scene) -> Scene:
    meshes = tuple(replace(mesh, interior=None, exterior=None) for mesh in scene.meshes)
    return replace(scene, meshes=meshes, camera=replace(scene.camera, medium=None), media=())


def choose_kernels_that_follow_samples(self: Replica, features: Features) -> None:
    CHOOSE_KERNELS(self, features)
    self.kernels = replace(self.kernels, trace_samples=make_trace_samples(replace(ALL, media=False, grids=False)))


CHOOSE_KERNELS = Replica._choose_kernels


@pytest.mark.parametrize("chosen", [PATH, GATHER], ids=["path", "photons"])
def test_samples_in_media_are_not_traced_whole(chosen: RenderSettings, monkeypatch: pytest.MonkeyPatch) -> None:
    with counted(monkeypatch, whole=True) as launched:
        alone(effect_scenes.fogs(), chosen)
    assert chosen.spp not in launched  # trials of the plan are of other numbers
