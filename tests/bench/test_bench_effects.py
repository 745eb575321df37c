"""`wdpm bench effects`: what each effect costs, at the least size."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import warp as wp

from wdpm import api
from wdpm.bench import effects, effects_compiler
from wdpm.bench import effects_scenes as effect_scenes
from wdpm.bench.effects_plot import plot
from wdpm.cli import main
from wdpm.cluster.render_settings import RenderSettings
from wdpm.images.image import Image
from wdpm.kernels.features import ALL, Features
from wdpm.progress import SilentProgress
from wdpm.rendering.in_process import InProcess
from wdpm.scenes.errors import WdpmError
from wdpm.scenes.model.scene import Scene


def measure_effects(**options: Any) -> effects.EffectFigures:
    few = RenderSettings(spp=1, photons=400, caustic_photons=400, volume_photons=400, k=5)
    return effects.measure(few, InProcess(threads=1), SilentProgress(), size=(8, 6), rounds=2, **options)


@pytest.mark.own_kernels
def test_an_effect_is_paid_for_where_it_is_called_for() -> None:
    asked: list[Any] = []

    def compiler(features: Any) -> tuple[float, int]:
        asked.append(features)
        return 2.0, 3

    figures = measure_effects(names=("+ mirror",), compiler=compiler)
    box, mirror = figures.scenes
    assert (box.name, mirror.name) == (effect_scenes.DIFFUSE, "+ mirror")
    assert box.features == ()
    assert mirror.features == ("conductor",)
    assert box.bits_equal
    assert mirror.bits_equal
    assert box.own.modules < mirror.own.modules < mirror.all_effects.modules
    assert asked == [None, (), ALL.names(), mirror.features]  # each set once, after what all share
    assert len(box.gain) == len(box.cpu_gain) == 2
    rows = figures.grid().rows
    assert [row[0] for row in rows] == ["diffuse box", "+ mirror"]
    assert {row[-1] for row in rows} == {"equal"}
    assert {row[-3] for row in rows} == {"2.00 s"}
    assert json.loads(json.dumps(figures.to_dict()))["scenes"][1]["features"] == ["conductor"]


def test_bits_that_differ_are_told() -> None:
    def render(scene: Scene, settings: RenderSettings) -> Image:
        image = api.render(scene, settings, threads=1)
        return in_memory_spoilt(image) if settings.all_effects else image

    figures = measure_effects(names=(effect_scenes.DIFFUSE,), render=render)
    assert figures.grid().rows[0][-1] == "DIFFER"
    assert figures.grid().rows[0][-3] == "-"
    assert "Bits of both kinds of kernels: NOT EQUAL" in plot(figures)


def in_memory_spoilt(image: Image) -> Image:
    beauty = image.pixels.copy()
    beauty[0, 0, 0] += 0.5
    return replace(image, layers={**image.layers, "beauty": beauty})


def effect_figures() -> effects.EffectFigures:
    times = [effects.Times(seconds, seconds, None, 7) for seconds in (1.0, 2.0, 4.0)]
    scenes = (
        effects.SceneFigures("box", (), times[0], times[1], True, (2.0,), (2.0,)),
        effects.SceneFigures("a <b>", (), times[1], times[2], True, (2.0,), (2.0,)),
    )
    return effects.EffectFigures((8, 6), RenderSettings(), 1, 1, None, scenes)


def test_the_plot_is_svg_with_a_bar_for_each() -> None:
    root = ElementTree.fromstring(plot(effect_figures()))
    bars = [float(each.attrib["width"]) for each in root if each.attrib.get("height") == "14"]
    assert np.divide(bars, bars[0]) == pytest.approx([1.0, 2.0, 2.0, 4.0], rel=1e-3)
    words = [each.text for each in root if each.tag.endswith("text")]
    assert "a <b>" in words
    assert any("it takes 2.00 times as long" in (text or "") for text in words)


def test_kernels_are_compiled_from_scratch(
    empty_cache: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the program that the benchmark starts, of two small modules in place of a scene's."""
    asked: list[Features] = []

    def variants(features: Features) -> Any:
        asked.append(features)
        return SimpleNamespace(modules=lambda: [small_module(addend) for addend in (1, 2)])

    monkeypatch.setattr(effects_compiler, "make_variants", variants)
    monkeypatch.setattr(sys, "stdin", StringIO(json.dumps({"features": ["conductor"], "cache": str(empty_cache)})))
    effects_compiler.main()
    answer = json.loads(capsys.readouterr().out)
    assert answer["seconds"] > 0
    assert answer["modules"] == 2
    assert asked == [Features(conductor=True)]


def small_module(addend: int) -> wp.Module:
    """A module with a kernel of its own."""

    @wp.kernel(module="unique", enable_backward=False)
    def add_here(values: wp.array[wp.int32]) -> None:
        values[wp.tid()] += wp.static(addend)

    return add_here.module


def test_a_process_that_cannot_compile_is_told_of() -> None:
    """It runs: what it does not know is its own word."""
    with pytest.raises(WdpmError, match=r"the process that compiles failed: TypeError: .*'smoke'"):
        effects.compile_from_scratch(("smoke",))


def test_an_effect_that_is_none_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["bench", "effects", "smoke"]) == 2
    assert "there is no scene 'smoke'; expected some of diffuse box, + textures" in capsys.readouterr().err
