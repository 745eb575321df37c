"""`wdpm accuracy` from end to end, on a small scene: its figures, its commands, its page, and going on."""

from __future__ import annotations

import csv
import io
import json
import re
import shlex
import shutil
import xml.etree.ElementTree as ET
from functools import partial
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import exit_code

from wdpm.accuracy import render as accuracy_render
from wdpm.accuracy import run as accuracy_run
from wdpm.accuracy.knobs import KNOBS, parse_sweep
from wdpm.accuracy.result import Accuracy
from wdpm.accuracy.run import Request, measure
from wdpm.accuracy.words import summary
from wdpm.cli import main
from wdpm.cluster.plan.copies import Copies
from wdpm.images.image import Image, load
from wdpm.local_backend import backend_here
from wdpm.progress import SilentProgress
from wdpm.scenes.errors import ImageError

SIZE = (20, 14)
ONE_THREAD = partial(backend_here, threads=1, copies=Copies.NONE)
CHOSEN = {"photons": 800, "spp": 2, "k": 20}
BASE = ["--photons", "800", "--spp", "2", "--k", "20"]
SWEEPS = ["photons=200,3k", "spp=1,8", "radius=0.5x,1x", "passes=1,2"]


def request(folder: Path, sweeps: list[str], **changes: Any) -> Request:
    options: dict[str, Any] = {"size": SIZE, "chosen": CHOSEN, "reference_time": 0.01} | changes
    return Request("cornell-box", folder, sweeps=tuple(map(parse_sweep, sweeps)), **options)


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Accuracy]:
    folder = tmp_path_factory.mktemp("accuracy")
    return folder, measure(request(folder, SWEEPS), ONE_THREAD, SilentProgress())


@pytest.fixture(scope="module")
def of_two_points(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Accuracy]:
    """A sweep of k=5,20, to be copied by whoever changes it."""
    folder = tmp_path_factory.mktemp("two points")
    return folder, measure(request(folder, ["k=5,20"]), ONE_THREAD, SilentProgress())


@pytest.fixture
def copied(of_two_points: tuple[Path, Accuracy], tmp_path: Path) -> Path:
    return shutil.copytree(of_two_points[0], tmp_path / "copy")


# ---- figures ------------------------------------------------------------------------------------------------------


def test_figures_are_those_of_the_saved_images(swept: tuple[Path, Accuracy]) -> None:
    folder, _ = swept
    a, b = (load(folder / f"reference-{half}.exr").pixels.astype(np.float64) for half in "ab")
    reference, own = (a + b) / 2, (a - b) ** 2 / 4
    for metric, weight in (("mse", np.ones_like(a)), ("rel_mse", 1 / (reference**2 + 0.01))):
        for point in json.loads((folder / "points.json").read_text())["points"]:
            images = np.stack([load(folder / image).pixels.astype(np.float64) for image in point["images"]])
            error = (weight * (images - reference) ** 2).mean() - (weight * own).mean()
            noise = (weight * images.var(axis=0, ddof=1)).mean()
            assert point[metric]["error"]["value"] == pytest.approx(error, rel=1e-9)
            assert point[metric]["noise"]["value"] == pytest.approx(noise, rel=1e-9)
            assert point[metric]["bias"]["value"] == pytest.approx(error - noise, rel=1e-6, abs=1e-9 * error)


def test_the_worst_pixels_can_be_left_out(swept: tuple[Path, Accuracy], tmp_path: Path) -> None:
    folder = shutil.copytree(swept[0], tmp_path / "copy")
    found = measure(request(folder, SWEEPS, trim=0.05, clock="cpu"), ONE_THREAD, SilentProgress())
    a, b = (load(folder / f"reference-{half}.exr").pixels.astype(np.float64) for half in "ab")
    reference, own = (a + b) / 2, (a - b) ** 2 / 4
    weight = 1 / (reference**2 + 0.01)

    def pixel_errors(number: int) -> np.ndarray:
        images = np.stack([load(folder / image).pixels.astype(np.float64) for image in found.points[number].images])
        return np.asarray((weight * (images - reference) ** 2).mean(axis=(0, 3)))

    errors = pixel_errors(0)
    parts = [pixel_errors(point.number) / pixel_errors(point.number).sum() for point in found.points]
    order = np.argsort(np.sum(parts, axis=0), axis=None)
    kept = order[: round(0.95 * order.size)]
    noise = (weight * own).mean(axis=2).ravel()[kept].mean()
    for point in found.points:
        expected = pixel_errors(point.number).ravel()[kept].mean() - noise
        assert point.rel_mse.error.value == pytest.approx(expected, rel=1e-9)
    assert all(point.seconds == point.cpu_seconds for point in found.points)
    worst = errors.max() / errors.sum()  # one of 280 pixels is more than 0.1 % of them
    assert found.worst == pytest.approx(worst, rel=1e-9)


def test_the_csv_has_the_same_figures(swept: tuple[Path, Accuracy]) -> None:
    folder, found = swept
    rows = list(csv.DictReader(io.StringIO((folder / "points.csv").read_text())))
    assert [int(row["point"]) for row in rows] == [point.number for point in found.points]
    assert [float(row["rel_mse_error"]) for row in rows] == [point.rel_mse.error.value for point in found.points]
    assert [float(row["wall_seconds"]) for row in rows] == [point.wall_seconds for point in found.points]
    assert [row["command"] for row in rows] == [point.command for point in found.points]
    assert [row["on_front"] == "True" for row in rows] == [point.number in found.front for point in found.points]


def test_the_csv_has_a_column_for_every_knob(tmp_path: Path) -> None:
    sweeps = ["light-samples=1,2", "band=0.5", "radius=2x"]
    found = measure(
        request(tmp_path, sweeps, chosen={**CHOSEN, "without": ("lens", "bump")}), ONE_THREAD, SilentProgress()
    )
    rows = list(csv.DictReader(io.StringIO((tmp_path / "points.csv").read_text())))
    points = json.loads((tmp_path / "points.json").read_text())["points"]
    for knob in KNOBS:
        assert knob.name in rows[0]
        assert knob.name in points[0]["settings"] or knob.name == "slaves"
    for curve in found.curves:
        assert [rows[number][curve.knob] for number in curve.points] == [str(value) for value in curve.values]
    assert rows[0]["light_samples"] == "4", "what the renderer chose"
    assert {(row["max_depth"], row["without"]) for row in rows} == {("", "lens,bump")}
    assert rows[0]["caustic_k"] == "50"


def test_more_samples_lower_the_noise(swept: tuple[Path, Accuracy]) -> None:
    _, found = swept
    curve = next(curve for curve in found.curves if curve.knob == "spp")
    assert curve.values == (1, 2, 8)
    noise = [found.points[number].rel_mse.noise.value for number in curve.points]
    assert noise == sorted(noise, reverse=True)


def test_no_point_of_the_front_is_dominated(swept: tuple[Path, Accuracy]) -> None:
    _, found = swept
    costs = [(point.seconds, point.rel_mse.error.value) for point in found.points]
    for number in found.front:
        time, error = costs[number]
        assert not any(t <= time and e <= error and (t, e) != (time, error) for t, e in costs)


def test_the_command_of_a_point_renders_its_image(swept: tuple[Path, Accuracy], tmp_path: Path) -> None:
    folder, found = swept
    point = next(point for point in found.points if point.name.startswith("radius"))
    words = shlex.split(point.command)
    assert words[:3] == ["wdpm", "render", "cornell-box"]
    assert exit_code([*words[1:], "-q", "-o", str(tmp_path / "point.exr")]) == 0
    again, kept = load(tmp_path / "point.exr"), load(folder / point.images[0])
    assert np.array_equal(again.pixels, kept.pixels)


# ---- the page -----------------------------------------------------------------------------------------------------


class Page(HTMLParser):
    """Looks for tags that are not closed in order, and for anything from elsewhere."""

    EMPTY = frozenset({"meta", "br", "img", "link", "path", "circle"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.links += [value or "" for name, value in attributes if name in ("src", "href")]
        assert tag not in ("script", "link")
        if tag not in self.EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.EMPTY:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def test_the_page_is_whole_and_needs_nothing_else(swept: tuple[Path, Accuracy]) -> None:
    folder, found = swept
    html = (folder / "index.html").read_text()
    page = Page()
    page.feed(html)
    page.close()
    assert not page.open
    assert not page.links
    assert all(url.startswith("data:image/png;base64,") for url in re.findall(r"url\(([^)]*)\)", html))
    for point in found.points:
        assert point.command in page.text
    assert summary(found)[0] in page.text
    pictures = re.findall(r"<svg .*?</svg>", html, flags=re.DOTALL)
    assert pictures
    for picture in pictures:
        root = ET.fromstring(picture)  # well-formed; this file's own output, so nothing hostile
        numbers = [float(n) for n in re.findall(r"-?\d+\.\d+", " ".join(e.get("d", "") for e in root.iter()))]
        assert all(-5 <= n <= 800 for n in numbers)


# ---- going on -----------------------------------------------------------------------------------------------------


class Stop(Exception):
    """In place of Ctrl-C."""


def test_an_interrupted_sweep_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = accuracy_render.PointRenderer.render
    rendered: list[tuple[Any, int]] = []
    limit = 5

    def render(self: accuracy_render.PointRenderer, point: Any, seed: int) -> Any:
        if seed < 100 and point.settings.integrator.value != "path":  # neither the trial nor the reference
            if len(rendered) == limit:
                raise Stop
            rendered.append((point, seed))
        return plain(self, point, seed)

    monkeypatch.setattr(accuracy_render.PointRenderer, "render", render)
    monkeypatch.setattr(accuracy_run, "_small", lambda settings: settings)
    with pytest.raises(Stop):
        measure(request(tmp_path, ["k=5,40"]), ONE_THREAD, SilentProgress())
    limit = 1000
    reference = (tmp_path / "reference.npz").read_bytes()
    found = measure(request(tmp_path, ["k=5,40"]), ONE_THREAD, SilentProgress())
    assert len(rendered) == 1 + 3 * len(found.points), "the trial and every render are done once"
    assert (tmp_path / "reference.npz").read_bytes() == reference
    measure(request(tmp_path, ["k=5,10,40"]), ONE_THREAD, SilentProgress())
    assert len(rendered) == 1 + 3 * 4, "a point that is new is rendered, the others are there"


def test_a_broken_record_is_told(copied: Path) -> None:
    record = next((copied / "renders").glob("*.json"))
    record.write_text("{")
    with pytest.raises(ImageError, match=f"{record.name}: is no record.*delete it"):
        measure(request(copied, ["k=5,20"]), ONE_THREAD, SilentProgress())


def test_a_truncated_image_is_told_before_anything_is_rendered(copied: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    image = next((copied / "renders").glob("*.exr"))
    image.write_bytes(image.read_bytes()[:700])
    monkeypatch.setattr(accuracy_render.PointRenderer, "render", lambda *_: pytest.fail("rendered"))
    with pytest.raises(ImageError, match=f"{image.name}: not a whole OpenEXR file.*; delete it and run again"):
        measure(request(copied, ["k=5,20,40"]), ONE_THREAD, SilentProgress())


def test_another_scene_uses_nothing_of_the_folder(of_two_points: tuple[Path, Accuracy], copied: Path) -> None:
    second = measure(request(copied, ["k=5,20"], size=(10, 8)), ONE_THREAD, SilentProgress())
    first, other = ({image for point in each.points for image in point.images} for each in (of_two_points[1], second))
    assert first.isdisjoint(other)


@pytest.mark.sockets
def test_the_band_and_slaves(tmp_path: Path) -> None:
    found = measure(request(tmp_path, ["band=0..1:3", "slaves=0,2"]), ONE_THREAD, SilentProgress())
    curve = found.curve_of("band")
    assert curve is not None
    narrow, _, exact = (found.points[number] for number in curve.points)
    assert exact.band is not None
    assert narrow.band is not None
    assert exact.bits_as_base
    assert exact.band.bits_equal
    assert (exact.band.mse, exact.band.max_abs, exact.band.pixels) == (0, 0, 0)
    assert narrow.band.mse > 0
    assert not narrow.band.bits_equal
    assert narrow.ghosts < exact.ghosts
    assert 0 < narrow.bytes < exact.bytes
    for point in (narrow, exact):
        images, exacts = ([load(tmp_path / name).pixels for name in each.images] for each in (point, found.points[0]))
        errors = [((a.astype(np.float64) - b) ** 2).mean() for a, b in zip(images, exacts, strict=True)]
        assert point.band is not None
        assert point.band.mse == pytest.approx(np.mean(errors), rel=1e-12)
    assert "every bit is that of one machine" in (tmp_path / "index.html").read_text()


# ---- bad input ----------------------------------------------------------------------------------------------------


def flat(path: Path, value: float = 1.0, size: tuple[int, int] = SIZE) -> Path:
    pixels = np.ones((size[1], size[0], 3), np.float32)
    pixels[5, 7] = value
    Image({"beauty": pixels}).save(path)
    return path


def test_two_halves_tell_the_noise_of_a_reference(tmp_path: Path) -> None:
    halves = (flat(tmp_path / "a.exr"), flat(tmp_path / "b.exr", 1.5))
    found = measure(request(tmp_path, ["k=5,20"], references=halves, reference_time=None), ONE_THREAD, SilentProgress())
    own = 0.25**2 / (1.25**2 + 0.01) / (SIZE[0] * SIZE[1])
    assert found.reference_noise == pytest.approx(own, rel=1e-6)
    one = measure(
        request(tmp_path, ["k=5,20"], references=halves[:1], reference_time=None), ONE_THREAD, SilentProgress()
    )
    assert one.reference_noise is None
    assert "its own noise is not known" in one.reference


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--sweep", "fotons=1,2"], "there is no knob 'fotons'"),
        (["--sweep", "k="], "it is empty"),
        (["--sweep", "k=5..2"], "smaller end first"),
        (["--sweep", "k=5", "--sweep", "k=9"], "swept twice"),
        (["--sweep", "k=5,900"], "at most 500"),
        (["--seeds", "2"], "--seeds is 2"),
        (["--trim", "0.5"], "--trim is 0.5"),
        (["--reference-time", "0s"], "is not a time"),
        (["--reference", "missing.exr"], "missing.exr: no such file"),
        (["--reference", "small.exr"], "the reference is 9x8, the renders are 20x14: give --size 9x8"),
        (["--reference", "nan.exr"], "1 pixels that are NaN or infinite, the first at 7,5"),
        (["--reference", "good.exr", "--reference-time", "3s"], "leave it or --reference out"),
        (
            ["--reference", "good.exr", "--reference", "good.exr"],
            "good.exr and good.exr: the two references have equal",
        ),
        (
            ["--reference", "good.exr", "--reference", "same.npy"],
            "good.exr and same.npy: the two references have equal",
        ),
        (["--reference", "black.exr"], "black.exr: the reference is black"),
        (["--sweep", "k=1..100000"], "--sweep k=1..100000: k is 100000; expected at most 500"),
        (["--sweep", "photons=5k,9k", "--integrator", "path"], "photons changes nothing in this render"),
        (["--reference", "good.exr", "--reference", "good.exr", "--reference", "good.exr"], "3 times"),
        (["-o", "good.exr"], "good.exr: results cannot be written there"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_rendered(
    arguments: list[str],
    complaint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def no_render(*_: object) -> None:
        raise AssertionError("rendered")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(accuracy_render.PointRenderer, "render", no_render)
    monkeypatch.setattr(accuracy_run, "find_facts", no_render)
    flat(Path("good.exr"))
    flat(Path("nan.exr"), float("nan"))
    flat(Path("small.exr"), size=(9, 8))
    flat(Path("same.npy"))
    Image({"beauty": np.zeros((SIZE[1], SIZE[0], 3), np.float32)}).save("black.exr")
    assert exit_code(["accuracy", "cornell-box", "--size", "20x14", "-q", *BASE, *arguments]) == main.EXIT_BAD_INPUT
    error = capsys.readouterr().err.strip()
    assert complaint in error
    assert "Traceback" not in error
    assert error.count("\n") == 0


def test_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["accuracy", "cornell-box", "--size", "12x10", *BASE, "--sweep", "spp=1,4", "--reference-time", "0.01s"]
    assert exit_code([*arguments, "-o", str(tmp_path / "new" / "folder")]) == 0
    output = capsys.readouterr()
    assert "plan: 3 points, 3 seeds each, 9 renders" in output.err
    assert "Pareto front" in output.out
    assert (tmp_path / "new" / "folder" / "index.html").is_file()
