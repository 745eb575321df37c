"""Adaptive sampling: where the samples go, and that the mean stays right."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.api import render
from wdpm.cluster.allotment import BLOCK, NO_ALLOTMENT, Allotment, spread
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.work.beams import chosen_samples
from wdpm.goal.convergence import ConvergenceEstimator
from wdpm.goal.goal import Metric
from wdpm.progress import SilentProgress
from wdpm.rendering import adaptive, passes
from wdpm.rendering.adaptive import AdaptiveSamples, weight_of
from wdpm.rendering.error_layers import ErrorEstimate
from wdpm.rendering.pass_plan import PassPlan
from wdpm.rendering.passes import PassRenderer
from wdpm.scenes import cornell_box
from wdpm.scenes.errors import SettingsError

WIDTH, HEIGHT = 6 * BLOCK, 4 * BLOCK + 3
Image = NDArray[np.float32]


def prepared(beams: bool = False) -> Any:
    """What is asked of a scene that is prepared."""
    camera = SimpleNamespace(width=WIDTH, height=HEIGHT)
    view = SimpleNamespace(camera=camera, diffuse_light=None, cache=SimpleNamespace(rounds=0), volume_samples=4)
    world = SimpleNamespace(volume_map=SimpleNamespace(paths=int(beams)))
    return SimpleNamespace(session=SimpleNamespace(view=view, world=world))


class Passes:
    """Passes of an image whose pixels are drawn: 1 on average, with a spread of their own."""

    def __init__(self, draw: Any, spp: int = 1, beams: bool = False) -> None:
        self.draw, self.spp, self.number = draw, spp, 0
        self.samples = AdaptiveSamples(prepared(beams))
        self.error = ErrorEstimate((HEIGHT, WIDTH, 3), False)
        self.counts: list[NDArray[np.int32]] = []
        self.sum: NDArray[np.float64] = np.zeros((HEIGHT, WIDTH, 3))

    def go_on(self) -> Allotment:
        plan = PassPlan(self.number, self.number * self.spp, self.spp)
        allotment = self.samples.next(plan, self.error)
        blocks = allotment.count if len(allotment) else np.full_like(self.samples.samples, self.spp)
        count = spread(blocks, WIDTH, HEIGHT)[..., None]
        most = int(count.max())
        drawn = np.stack([self.draw(self.number * 100 + each) for each in range(most)])
        total = (drawn * (np.arange(most)[:, None, None, None] < count)).sum(axis=0)
        self.sum += total
        image = (total / np.maximum(count, 1)).astype(np.float32)
        self.samples.add(plan, allotment, {"beauty": image})
        self.error.add({"beauty": image}, weight_of(plan, allotment, WIDTH, HEIGHT), 1.0)
        self.counts.append(blocks)
        self.number += 1
        return allotment

    def mean(self) -> NDArray[np.float64]:
        return self.sum / spread(self.samples.samples, WIDTH, HEIGHT)[..., None]


def noisy_on_the_left(number: int) -> Image:
    """Ten times the spread in the left half."""
    spread_of = np.where(np.arange(WIDTH) < WIDTH // 2, 0.5, 0.05)[:, None]
    drawn = np.random.default_rng(number).standard_normal((HEIGHT, WIDTH, 1))
    return ((1.0 + spread_of * drawn) * np.ones(3)).astype(np.float32)


@pytest.mark.parametrize("spp", [1, 2, 8, 24])
def test_samples_go_where_the_noise_is_and_are_as_many_in_all(spp: int) -> None:
    rendered = Passes(noisy_on_the_left, spp)
    pixels = rendered.samples._pixels()
    for _ in range(12):
        rendered.go_on()
        given = int((rendered.counts[-1] * pixels).sum())
        portion = max(1, spp // adaptive.STEPS) * BLOCK**2
        assert spp * WIDTH * HEIGHT - portion < given <= spp * WIDTH * HEIGHT
    total = rendered.samples.samples
    np.testing.assert_array_equal(total, np.sum(rendered.counts, axis=0))
    assert total[:, :2].mean() > 2.5 * total[:, 4:].mean()
    assert all(count.min() >= 1 for count in rendered.counts[: adaptive.LEAST_PASSES])


def test_no_part_is_given_up() -> None:
    """Whatever the rest needs, each block has samples in each window of passes, in even and in odd ones."""
    rendered = Passes(noisy_on_the_left)
    for _ in range(24):
        rendered.go_on()
    had = np.stack(rendered.counts) > 0
    for start in range(0, 24, adaptive.WINDOW):
        assert had[start : start + adaptive.WINDOW].any(axis=0).all()
    assert had[0::2].any(axis=0).all()
    assert had[1::2].any(axis=0).all()
    assert not had[adaptive.LEAST_PASSES :].all()


def test_passes_are_alike_everywhere_where_that_is_best() -> None:
    """And so is the first pass of all, and the second, after which something is known."""
    rendered = Passes(lambda _: np.zeros((HEIGHT, WIDTH, 3), np.float32))
    for _ in range(6):
        rendered.go_on()
    assert all((count == 1).all() for count in rendered.counts)
    assert not len(Passes(noisy_on_the_left).go_on())


@pytest.mark.parametrize("shape", [(5, 6), (2, 2), (2, 7)])
def test_what_a_block_sees_itself_does_not_decide_how_many_samples_it_gets(shape: tuple[int, int]) -> None:
    """Or one that rare light has hit would be diluted, and one that it has missed left as it is."""
    rng = np.random.default_rng(3)
    errors = rng.random(shape)
    told = adaptive._around(errors)
    for place in np.ndindex(shape):
        other = errors.copy()
        other[place] += 100.0
        changed = adaptive._around(other) != told
        assert not changed[place]
        assert changed.sum() >= 3
    np.testing.assert_allclose(adaptive._around(np.full(shape, 2.0)), 2.0)


def test_rare_light_stays_in_the_mean() -> None:
    """A tenth of all light in one sample of a hundred: the mean over many images is right within its own noise."""
    means = []
    for seed in range(24):

        def draw(number: int, seed: int = seed) -> Image:
            hit = np.random.default_rng([seed, number]).random((HEIGHT, WIDTH, 1)) < 0.01
            return ((0.9 + 10.0 * hit) * np.ones(3)).astype(np.float32)

        rendered = Passes(draw)
        for _ in range(8):
            rendered.go_on()
        means.append(rendered.mean().mean())
    noise = np.std(means) / math.sqrt(len(means))
    assert np.mean(means) == pytest.approx(1.0, abs=4.0 * noise)
    assert noise < 0.005


def test_infinite_light_and_unknown_spreads_decide_nothing() -> None:
    def draw(number: int) -> Image:
        image = noisy_on_the_left(number)
        image[0, 0] = np.inf
        return image

    rendered = Passes(draw)
    with np.errstate(invalid="ignore"):
        for _ in range(5):
            rendered.go_on()
    assert (rendered.counts[-1] >= 0).all()
    assert rendered.counts[-1].sum() > 0


def test_beams_are_looked_for_by_whole_portions() -> None:
    rendered = Passes(noisy_on_the_left, spp=6, beams=True)
    for _ in range(5):
        rendered.go_on()
    assert all((count % 6 == 0).all() for count in rendered.counts)
    assert len({int(value) for value in rendered.counts[-1].flat}) > 1


@pytest.mark.parametrize(("spp", "most"), [(6, 4), (7, 2), (3, 4)])
def test_any_run_of_samples_has_as_many_that_look_for_light_in_media(spp: int, most: int) -> None:
    one_block = Allotment(np.zeros((1, 1), np.int32), np.zeros((1, 1), np.int32))
    view: Any = SimpleNamespace(spp=spp, volume_samples=most, first_sample=20, allotment=one_block)
    for first in range(13, 28):
        chosen, weight = chosen_samples(view, np.arange(first, first + spp, dtype=np.int32))
        assert chosen.sum() <= most
        assert chosen.sum() * weight == pytest.approx(spp)


def test_the_estimated_noise_is_that_of_unequal_samples() -> None:
    """Of the mean over many images, the spread is the one that each of them tells of itself."""
    told, means = [], []
    for seed in range(20):

        def draw(number: int, seed: int = seed) -> Image:
            return noisy_on_the_left(number + 10_000 * seed)

        rendered = Passes(draw)
        for _ in range(16):
            rendered.go_on()
        told.append(rendered.error.variance())
        means.append(rendered.mean())
    actual, expected = np.var(means, axis=0, ddof=1), np.mean(told, axis=0)
    for part in (slice(0, WIDTH // 2 - BLOCK), slice(WIDTH // 2 + BLOCK, WIDTH)):
        assert actual[:, part].mean() == pytest.approx(expected[:, part].mean(), rel=0.1)


def test_the_estimate_that_renders_stop_at_knows_unequal_samples() -> None:
    rendered, estimator = Passes(noisy_on_the_left), ConvergenceEstimator((HEIGHT, WIDTH, 3), Metric.RELMSE, False)
    for number in range(16):
        before = rendered.sum.copy()
        allotment = rendered.go_on()
        plan = PassPlan(number, number, 1)
        weight = weight_of(plan, allotment, WIDTH, HEIGHT)
        image = (rendered.sum - before) / np.maximum(weight, 1.0)
        estimator.add({"beauty": image.astype(np.float32)}, weight, 1.0)
    np.testing.assert_allclose(estimator.mean(), rendered.mean(), rtol=1e-5)
    estimate = estimator.estimate()
    assert estimate is not None
    truth = float(((rendered.mean() - 1.0) ** 2).mean() / 1.01)
    assert estimate.noise.value == pytest.approx(truth, rel=0.25)


# Renders.

FEW = RenderSettings(photons=2000, spp=12, passes=6, k=20, adaptive=True)
SIZE = (3 * BLOCK, 2 * BLOCK + 4)


def test_an_image_says_how_many_samples_each_part_had() -> None:
    scene = cornell_box(SIZE)
    image = render(scene, FEW)
    samples = image.layers["samples"]
    assert samples.shape == (SIZE[1], SIZE[0])
    assert samples.mean() == pytest.approx(12.0, rel=0.1)
    assert samples.min() < 12.0 < samples.max()
    assert image.metadata["settings"]["adaptive"] is True
    plain = render(scene, RenderSettings(**{**vars(FEW), "adaptive": False}))
    assert "samples" not in plain.layers
    difference = np.abs(image.layers["beauty"].mean(axis=(0, 1)) / plain.layers["beauty"].mean(axis=(0, 1)) - 1.0)
    assert difference.max() < 0.1
    for name in ("albedo", "normal", "depth"):  # what hardly changes from sample to sample is alike
        np.testing.assert_allclose(
            image.layers[name][4:-4, 4:-4].mean(), plain.layers[name][4:-4, 4:-4].mean(), rtol=0.05, err_msg=name
        )


class Notes(SilentProgress):
    """Keeps what a person is told."""

    def __init__(self) -> None:
        self.notes: list[str] = []

    def note(self, text: str) -> None:
        self.notes.append(text)


def test_two_passes_are_those_of_a_render_that_is_not_adaptive() -> None:
    scene = cornell_box(SIZE)
    two = {**vars(FEW), "passes": 2, "spp": 4}
    told = Notes()
    image = render(scene, RenderSettings(**two), progress=told)
    assert [note for note in told.notes if "adaptive sampling begins with pass 3" in note]
    plain = render(scene, RenderSettings(**{**two, "adaptive": False}))
    assert (image.layers.pop("samples") == 4).all()
    assert image.digest() == plain.digest()


def test_an_interrupted_render_goes_on_to_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, file = cornell_box(SIZE), tmp_path / "journal"
    whole = render(scene, FEW)
    original = PassRenderer.render

    def stopping(self: PassRenderer, plan: PassPlan, allotment: Allotment = NO_ALLOTMENT) -> Any:
        if plan.number == 4:
            raise KeyboardInterrupt
        return original(self, plan, allotment)

    with monkeypatch.context() as patched:
        patched.setattr(passes.PassRenderer, "render", stopping)
        with pytest.raises(KeyboardInterrupt):
            render(scene, FEW, journal=file)
    assert render(scene, FEW, journal=file, resume=True).digest() == whole.digest()


def test_an_image_without_passes_to_learn_from_cannot_be_replayed() -> None:
    from wdpm.rendering.in_process import InProcess
    from wdpm.replaying.run import Replayer

    with pytest.raises(SettingsError, match="sampled adaptively"):
        Replayer(cornell_box(SIZE), InProcess(), FEW)
