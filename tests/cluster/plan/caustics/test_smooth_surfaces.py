"""Which surfaces make caustics that shadow rays of paths do not find."""

from __future__ import annotations

from dataclasses import replace

import pytest

from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.plan.path_caustics import may_have_caustics
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.bsdfs import Conductor, Leaf, RoughPane, Translucent

SETTINGS = RenderSettings(integrator=Integrator.PHOTONS)


@pytest.mark.parametrize(
    ("leaf", "hidden"),
    [(Conductor(), True), (Conductor(alpha_u=0.3, alpha_v=0.3), False), (RoughPane(), False), (Translucent(), False)],
    ids=["mirror", "rough metal", "rough pane", "curtain"],
)
def test_what_spreads_light_hides_no_lamp(leaf: Leaf, hidden: bool) -> None:
    """Curtains were taken for mirrors: a plan thought paths thirty times as noisy as they were."""
    box = cornell_box((16, 12))
    materials = (*box.materials[:-1], replace(box.materials[-1], bsdf=leaf))
    flat = flatten(replace(box, materials=materials))
    assert may_have_caustics(flat, features_of(flat, SETTINGS), SETTINGS) is hidden
