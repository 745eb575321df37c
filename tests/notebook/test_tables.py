"""What notebooks show of scenes, reports and plans: tables, in which nothing of a file is taken for HTML."""

from __future__ import annotations

import json
from dataclasses import replace
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest

import wdpm
from wdpm.cluster.render_settings import Indirect
from wdpm.report.notebook import notebook_report
from wdpm.report.report import LightPhotons, PhotonCounts, Report, SlaveReport
from wdpm.scenes.html_tables import html_lines, html_table

EVIL = "<script>[bold]&"
SAFE = "&lt;script&gt;[bold]&amp;"


class Tables(HTMLParser):
    """Tags that are open, and the cells of all tables."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.cells: list[str] = []
        self.tags: set[str] = set()
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: Any) -> None:  # noqa: ARG002
        self.open.append(tag)
        self.tags.add(tag)
        if tag in ("td", "th", "li", "b"):
            self.cells.append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.cells[-1] += data


def test_a_scene_is_a_table() -> None:
    scene = wdpm.load("cornell-box", size=(20, 10))
    shown = Tables(scene._repr_html_())
    assert f"20 x 10 pixels, {scene.camera.fov_x:.4g} degrees wide" in shown.cells
    assert "cornell-box" in shown.cells
    assert {mesh.name for mesh in scene.meshes} <= set(shown.cells)


def test_names_of_a_file_are_escaped() -> None:
    scene = wdpm.load("cornell-box")
    text = replace(scene, name=EVIL, warnings=(EVIL,))._repr_html_()
    assert text.count(SAFE) == 2
    assert "<script>" not in text


def test_a_prompt_shows_a_line_and_no_arrays() -> None:
    scene = wdpm.load("cornell-box", size=(8, 6))
    assert repr(scene) == "<Scene 'cornell-box': 32 triangles in 8 meshes, 8x6 pixels>"
    image = wdpm.render(scene, spp=1, photons=500)
    assert repr(image) == f"<Image 8x6: {', '.join(image.layers)}>"


def test_a_report_is_what_the_terminal_shows() -> None:
    light = LightPhotons(EVIL, 10, 5, 1.0)
    slave = SlaveReport("anna", 1, 1_000, 5, 2, 0, 0, 0, 0, 0.5, 1 << 20)
    report = Report(
        phases={"load": 0.5, "render": 1.5},
        triangles=1_000,
        photons=PhotonCounts(5, 10, 5, (light, replace(light, name="lamp"))),
        slaves=(slave, replace(slave, slave="bert")),
        warnings=(EVIL,),
    )
    text = notebook_report(report.to_dict())._repr_html_()
    shown = Tables(text)
    assert {"render", "1.50 s", "75.0%", "anna", "1,000", "1.0 MB"} <= set(shown.cells)
    assert f"warning: {EVIL}" in shown.cells
    assert EVIL in shown.cells
    assert shown.tags <= {"table", "caption", "b", "thead", "tbody", "tr", "th", "td", "ul", "li"}


def test_an_image_has_its_report() -> None:
    image = wdpm.render(wdpm.load("cornell-box", size=(8, 8)), photons=500, spp=1, indirect=Indirect.MAP)
    assert image.report.to_dict() == json.loads(json.dumps(image.metadata["report"]))
    assert "photons: 500 asked for" in image.report._repr_html_()
    bare = wdpm.Image({"beauty": np.zeros((1, 1, 3), np.float32)})
    with pytest.raises(wdpm.WdpmError, match="the image has no report"):
        _ = bare.report


def test_a_plan_is_what_wdpm_inspect_shows() -> None:
    plan = wdpm.inspect(wdpm.load("cornell-box", size=(8, 8)), slaves=3, photons=1_000)
    assert isinstance(plan, wdpm.Plan)
    shown = Tables(plan._repr_html_())
    assert "Plan: what the scene calls for" in shown.cells
    assert "What each slave would hold" in shown.cells
    assert {str(slave) for slave in range(3)} <= set(shown.cells)
    assert {effect.words for effect in plan.effects} <= set(shown.cells)


def test_tables_are_whole() -> None:
    text = html_table(EVIL, ("a", "b"), [(EVIL, 1.5)]) + html_table("", (), [("x", "y")]) + html_lines([EVIL])
    assert Tables(text).cells == [EVIL, "a", "b", EVIL, "1.5", "x", "y", EVIL]
    assert html_lines([]) == ""
