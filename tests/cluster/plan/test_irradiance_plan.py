"""Irradiance that gather rays read: how long the paths are that it is of, where paths may only be so long."""

from __future__ import annotations

from dataclasses import replace

import pytest

import wdpm
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.cluster.world import IrradiancePlan
from wdpm.kernels.launch import Launcher
from wdpm.progress import SilentProgress
from wdpm.rendering.prepare import prepare
from wdpm.scenes import cornell_box

GATHERED = RenderSettings(indirect=Indirect.GATHER, photons=2000, k=20, spp=2)
SCENE = cornell_box((16, 12))


def plan(settings: RenderSettings) -> IrradiancePlan:
    """Of a Cornell box."""
    return prepare(SCENE, settings, 1, Launcher("cpu", 1), SilentProgress()).session.world.irradiance


def longest(max_depth: int | None) -> int:
    """Edges of the longest paths that bring light to the photons."""
    return plan(replace(GATHERED, max_depth=max_depth)).longest


@pytest.mark.parametrize(
    ("spp", "passes", "share"),
    [(1, 1, 0.0625), (3, 1, 0.125), (4, 1, 0.125), (5, 1, 0.25), (8, 2, 0.125), (8, 4, 0.0625)],
)
def test_few_samples_read_at_fewer_photons_which_are_as_easily_found(spp: int, passes: int, share: float) -> None:
    few, many = (plan(replace(GATHERED, spp=each, passes=passes)) for each in (spp, 64))
    assert few.share == share
    assert few.share * few.reach**2 == pytest.approx(many.share * many.reach**2, rel=1e-5)


def test_paths_that_bring_next_to_nothing_do_not_count() -> None:
    """Albedos are up to 0.76: of ten scatterings 0.76^10 = 0.06 is left, of thirty 0.0003."""
    assert longest(None) == 0
    assert longest(3) == 2  # one edge is the camera's
    assert 10 < longest(65) < 30


@pytest.mark.parametrize("way", [Indirect.GATHER, Indirect.CACHE])
def test_a_limit_that_no_light_comes_to_changes_no_bit(way: Indirect) -> None:
    """As the files of many rooms have it: it takes no more time either, since nobody asks photons for their lengths."""
    settings = replace(GATHERED, indirect=way)
    unlimited, far, near = (wdpm.render(SCENE, replace(settings, max_depth=most)) for most in (None, 200, 6))
    assert far.digest() == unlimited.digest() != near.digest()
    gathers = [image.metadata["report"]["gathers"] for image in (unlimited, far, near)]
    assert gathers[0] == gathers[1] == 0 < gathers[2]
