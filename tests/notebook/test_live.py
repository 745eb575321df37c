"""`live=True`: what a notebook is told, how seldom, and what happens where there is no notebook."""

from __future__ import annotations

import io
import sys
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image as PillowImage

import wdpm
from wdpm import notebook
from wdpm.cluster.display import Bucket, Displays, Frame
from wdpm.cluster.render_settings import Indirect
from wdpm.notebook import BAR_S, PICTURE_S, SHARE, LiveRender
from wdpm.progress import SilentProgress

SMALL: dict[str, Any] = {"photons": 500, "indirect": Indirect.MAP, "bucket": 8}


class Shown:
    """Keeps what a place in a notebook was told."""

    def __init__(self) -> None:
        self.data: list[Mapping[str, Any]] = []

    def update(self, data: Mapping[str, Any], *, raw: bool) -> None:
        assert raw
        self.data.append(data)

    @property
    def last(self) -> Any:
        return next(iter(self.data[-1].values()))


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def pixels_of(png: bytes) -> Any:
    return np.asarray(PillowImage.open(io.BytesIO(png)))


@pytest.fixture
def places(monkeypatch: pytest.MonkeyPatch) -> tuple[Shown, Shown]:
    """A notebook, without one: its picture and its bar."""
    shown = Shown(), Shown()
    monkeypatch.setattr(notebook, "in_notebook", lambda: True)
    monkeypatch.setattr(notebook, "_places", lambda: shown)
    return shown


def test_a_live_render_has_the_same_bits_and_ends_with_the_image(places: tuple[Shown, Shown]) -> None:
    scene = wdpm.load("cornell-box", size=(16, 16))
    plain = wdpm.render(scene, spp=2, **SMALL)
    live = wdpm.render(scene, spp=2, live=True, **SMALL)
    assert live.digest() == plain.digest()
    picture, bar = places
    np.testing.assert_array_equal(pixels_of(picture.last), plain.to_srgb8())
    assert any("<progress" in data["text/html"] for data in bar.data)
    assert bar.data[-1]["text/plain"].startswith("done in ")
    assert "<" not in bar.last


def test_other_displays_and_observers_are_told_too(places: tuple[Shown, Shown]) -> None:
    told: list[str] = []

    class Observer(SilentProgress):
        def start(self, phase: str, total: int | None = None) -> None:  # noqa: ARG002
            told.append(phase)

    other = LiveRender(Shown(), Shown(), SilentProgress())
    wdpm.render(wdpm.load("cornell-box", size=(8, 8)), spp=1, live=True, display=other, progress=Observer(), **SMALL)
    assert "render" in told
    assert other._picture.size == (8, 8)
    assert len(places[0].data) >= 1


@pytest.mark.sockets
def test_a_cluster_shows_its_renders_too(places: tuple[Shown, Shown]) -> None:
    with wdpm.Cluster.local(slaves=1) as cluster:
        image = cluster.render(wdpm.load("cornell-box", size=(8, 8)), spp=1, live=True, **SMALL)
        assert cluster.display is None  # what follows is shown to nobody
    np.testing.assert_array_equal(pixels_of(places[0].last), image.to_srgb8())


def test_elsewhere_one_line_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    image = wdpm.render(wdpm.load("cornell-box", size=(8, 8)), spp=1, live=True, **SMALL)
    assert image.shape == (8, 8)
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("wdpm:")]
    assert lines == ["wdpm: live=True shows the image in a notebook, which this is not: it renders without"]


@pytest.mark.parametrize(("shell", "expected"), [(None, False), (SimpleNamespace(), False), ("kernel", True)])
def test_a_notebook_is_ipython_with_a_kernel(monkeypatch: pytest.MonkeyPatch, shell: Any, expected: bool) -> None:
    running = SimpleNamespace(kernel=object()) if shell == "kernel" else shell
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: running))  # type: ignore[arg-type]
    assert notebook.in_notebook() is expected


def test_a_render_that_fails_says_so_in_its_place(places: tuple[Shown, Shown]) -> None:
    with pytest.raises(wdpm.WdpmError, match="bucket"):
        wdpm.render(wdpm.load("cornell-box", size=(8, 8)), live=True, bucket=-1)
    assert places[1].data[-1]["text/plain"].startswith("failed in ")


def test_it_is_drawn_no_more_often_than_is_worth_it() -> None:
    picture, bar, clock = Shown(), Shown(), Clock()
    live = LiveRender(picture, bar, SilentProgress(), clock)
    live.begin(Frame(4, 4, {"beauty": 3}, 0, 1, (0,), ("one",)))
    bucket = Bucket(0, 0, {"beauty": np.full((4, 4, 3), 0.5, np.float32)}, 0)
    live.bucket(bucket)
    live.start("render", 100)
    assert (len(picture.data), len(bar.data)) == (1, 1)
    for _ in range(10):
        live.bucket(bucket)
        live.advance(1)
    assert (len(picture.data), len(bar.data)) == (1, 1)
    clock.now += max(BAR_S, PICTURE_S)
    live.bucket(bucket)
    live.advance(15)
    assert (len(picture.data), len(bar.data)) == (2, 2)
    assert "render: 25 of 100" in bar.last
    assert 'value="0.2500"' in bar.last


def test_a_slow_notebook_costs_no_more_than_its_share() -> None:
    clock = Clock()

    class Slow(Shown):
        def update(self, data: Mapping[str, Any], *, raw: bool) -> None:
            super().update(data, raw=raw)
            clock.now += 1.0

    picture = Slow()
    live = LiveRender(picture, Shown(), SilentProgress(), clock)
    live.begin(Frame(1, 1, {"beauty": 3}, 0, 1, (0,), ("one",)))
    bucket = Bucket(0, 0, {"beauty": np.full((1, 1, 3), np.nan, np.float32)}, 0)
    while clock.now < 500.0:
        clock.now += 0.1
        live.bucket(bucket)
    assert len(picture.data) <= 500.0 * SHARE + 1
    assert pixels_of(picture.last).shape == (1, 1, 3)


def test_what_phases_are_called_is_escaped() -> None:
    bar = Shown()
    LiveRender(Shown(), bar, SilentProgress()).start("<script>", 3)
    assert "&lt;script&gt;" in bar.last


def test_displays_have_enough_when_one_has() -> None:
    without = LiveRender(Shown(), Shown(), SilentProgress())
    enough: Any = SimpleNamespace(enough=True)
    assert not Displays([without]).enough
    assert Displays([without, enough]).enough
