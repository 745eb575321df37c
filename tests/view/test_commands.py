"""`--view` and `wdpm view`: the same bits, an end when there is enough, and a line for each mistake."""

from __future__ import annotations

import argparse
import re
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import refusal
from patience import WAIT_S
from watching import Page, watch

import wdpm
from wdpm.cli import live, main
from wdpm.cluster.display import Bucket, Frame, PassMean, SlaveSeen
from wdpm.cluster.render_settings import Indirect
from wdpm.images.image import Image, load
from wdpm.view.open_files import FileView

SMALL = ["render", "cornell-box", "--size", "16x16", "--photons", "500", "--spp", "6", "--indirect", "map", "-q"]


class EnoughAfter:
    """A display that has enough of passes after some."""

    def __init__(self, passes: int) -> None:
        self._passes = passes
        self.shown: list[tuple[int, bool]] = []

    @property
    def enough(self) -> bool:
        return len(self.shown) >= self._passes

    def begin(self, frame: Frame) -> None:
        assert frame.first_sample == len(self.shown) * frame.spp

    def bucket(self, bucket: Bucket) -> None:
        assert np.isfinite(bucket.layers["beauty"]).all()

    def slaves(self, seen: Sequence[SlaveSeen]) -> None:
        assert [slave.lost for slave in seen] == [False]

    def end(self, statistics: Sequence[Mapping[str, Any]]) -> None:
        assert len(statistics) == 1

    def pass_done(self, mean: PassMean) -> None:
        self.shown.append((mean.spp, mean.relative_error() is not None))


def test_who_has_enough_gets_the_image_of_as_many_passes() -> None:
    display = EnoughAfter(2)
    scene = wdpm.load("cornell-box", size=(16, 16))
    how = {"photons": 500, "bucket": 8, "indirect": Indirect.MAP}
    image = wdpm.render(scene, display=display, passes=6, spp=6, **how)
    fewer = wdpm.render(scene, passes=2, spp=2, **how)
    assert display.shown == [(1, False), (2, True)]
    assert image.digest() == fewer.digest()
    assert len(image.metadata["report"]["passes"]) == 2


def test_a_view_changes_no_bit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plain, viewed = tmp_path / "plain.exr", tmp_path / "viewed.exr"
    assert main.main([*SMALL, "--passes", "3", "-o", str(plain)]) == 0
    assert main.main([*SMALL, "--passes", "3", "-o", str(viewed), "--view", "--view-beside", str(plain)]) == 0
    assert load(viewed).digest() == load(plain).digest()
    assert re.fullmatch(r"view: http://127\.0\.0\.1:\d+/[\w-]{22}/\n", capsys.readouterr().err)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([*SMALL, "--view-at", "7118"], "--view-at says how to view: give --view, too"),
        ([*SMALL, "--view", "--view-beside", "none.exr"], "none.exr: no such file"),
        ([*SMALL, "--view", "--replay", "1,1,0"], "--replay makes no image that --view could show"),
        ([*SMALL, "--view", "--view-at", "here:there"], "'here:there' is no HOST:PORT, like 127.0.0.1:7118"),
        (["view", "none.exr"], "none.exr: no such file"),
    ],
)
def test_mistakes_are_one_line(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert message in refusal(arguments, capsys)


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, "aiohttp", None)
    assert main.main([*SMALL, "--view"]) == 2
    assert capsys.readouterr().err == "wdpm: error: the live view needs aiohttp: pip install 'wdpm[view]'\n"


def test_who_lets_others_in_is_warned(capsys: pytest.CaptureFixture[str]) -> None:
    live.print_url("http://0.0.0.0:1/t/", live.ViewAddress("0.0.0.0", 1))
    assert "is not encrypted" in capsys.readouterr().err


@pytest.mark.parametrize(("how", "raised"), [("stopped", KeyboardInterrupt), ("failed: no memory", RuntimeError)])
def test_pages_hear_how_a_render_ended(how: str, raised: type[BaseException]) -> None:
    args = argparse.Namespace(
        view=True, view_at=None, view_beside=None, passes=None, until_error=None, time_budget=None, scene="a box"
    )
    kept: list[Any] = []

    def render() -> None:
        with live.live_view(args) as view:
            kept.append(view)
            raise raised("no memory")

    with pytest.raises(raised):
        render()
    assert kept[0]._state()["ended"] == how


async def both_are_shown(page: Page) -> None:
    await page.until(lambda: bool(page.status))
    assert page.status["title"] == "one.exr | other.exr"
    await page.socket.send_json({"kind": "want", "layers": [["a", "beauty"], ["b", "beauty"]]})
    await page.until(lambda: len(page.layers) == 2)
    assert page.layers["b", "beauty"][3, 5, 0] == 1.0


def flat(value: float) -> Image:
    return Image({"beauty": np.full((4, 6, 3), value, np.float32)})


@pytest.mark.sockets
def test_files_are_shown_until_someone_presses_ctrl_c(tmp_path: Path) -> None:
    files = [tmp_path / "one.exr", tmp_path / "other.exr"]
    for value, file in enumerate(files):
        flat(value).save(file)
    command = [sys.executable, "-m", "wdpm", "view", *map(str, files)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        watch(process.stderr.readline().removeprefix("view: ").strip(), both_are_shown)
        process.send_signal(signal.SIGINT)
        assert process.wait(WAIT_S) == 130
        assert process.stderr.read() == "wdpm: interrupted\n"


@pytest.mark.sockets
def test_the_page_can_end_it_too() -> None:
    view = FileView(live.ViewAddress(), "one.exr | other.exr", flat(0.0), flat(1.0))

    async def look(page: Page) -> None:
        await both_are_shown(page)
        await page.socket.send_json({"kind": "stop"})

    watch(view.url, look)
    view.wait()
    view.close()
