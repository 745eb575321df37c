"""Each integrator says of itself what others ask, and nobody else asks which one it is."""

from __future__ import annotations

import ast
import copy
import re
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest

from wdpm.cluster.integrators.registry import REFERENCE
from wdpm.cluster.render_settings import EFFECTS_TO_LEAVE_OUT, Indirect, Integrator, RenderSettings, Routing
from wdpm.kernels.camera.diffuse_light import DiffuseLight
from wdpm.scenes import cornell_box
from wdpm.scenes.errors import SettingsError
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.flat.shapes import Instancing

ROOT = Path(__file__).parents[2]
REGISTRY = Path("cluster/integrators/registry.py")

each = pytest.mark.parametrize("integrator", Integrator, ids=lambda integrator: integrator.value)


def _asks_for_a_name(node: ast.AST) -> bool:
    """Whether a comparison or a case is about a member of Integrator."""
    if not isinstance(node, ast.Compare | ast.MatchValue):
        return False
    named = (inner for inner in ast.walk(node) if isinstance(inner, ast.Attribute))
    return any(isinstance(inner.value, ast.Name) and inner.value.id == "Integrator" for inner in named)


def test_nobody_asks_which_integrator_it_is() -> None:
    asking = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for wing in ("scenes", "kernels", "cluster", "wdpm")
        for path in (ROOT / wing).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if _asks_for_a_name(node) and path.relative_to(ROOT) != REGISTRY
    ]
    assert asking == []


def test_a_question_by_name_would_be_found() -> None:
    for code in ("x is Integrator.PATH", "Integrator.PATH.value != x", "x in (1, Integrator.PATH)"):
        assert any(map(_asks_for_a_name, ast.walk(ast.parse(code)))), code


@each
def test_a_name_stands_for_its_integrator(integrator: Integrator) -> None:
    assert Integrator(integrator.algorithm.name) is integrator
    assert integrator.value == integrator.algorithm.name
    assert integrator.algorithm.option_help.startswith(integrator.value)
    assert copy.deepcopy(integrator) is integrator


@each
def test_settings_take_its_name(integrator: Integrator) -> None:
    assert RenderSettings(integrator=integrator.value) == RenderSettings(integrator=integrator)  # type: ignore[arg-type]


def test_other_choices_go_by_name_as_well() -> None:
    named = RenderSettings(indirect="map", routing="merge", instances="keep")  # type: ignore[arg-type]
    assert named == RenderSettings(indirect=Indirect.MAP, routing=Routing.MERGE, instances=Instancing.KEEP)


@pytest.mark.parametrize("wrong", ["paths", 3, None, ["path"]])
def test_a_name_that_is_none_is_refused(wrong: Any) -> None:
    known = 'expected one of "photons", "path", "auto", or a member of Integrator'
    with pytest.raises(SettingsError, match=f"integrator is {re.escape(repr(wrong))}; {known}"):
        RenderSettings(integrator=wrong)


@each
def test_what_it_says_of_settings_holds(integrator: Integrator) -> None:
    algorithm = integrator.algorithm
    assert set(algorithm.ignored) <= {field.name for field in fields(RenderSettings)}
    assert bool(algorithm.ignored) == bool(algorithm.why_ignored)
    refused = set()
    for effect in EFFECTS_TO_LEAVE_OUT:
        try:
            RenderSettings(integrator=integrator, without=(effect,))
        except SettingsError:
            refused.add(effect)
    assert refused == algorithm.cannot_leave_out


@each
@pytest.mark.parametrize("indirect", Indirect, ids=lambda indirect: indirect.value)
@pytest.mark.parametrize("photons", [0, 1000])
def test_its_answers_agree(integrator: Integrator, indirect: Indirect, photons: int) -> None:
    algorithm = integrator.algorithm
    settings = RenderSettings(integrator=integrator, indirect=indirect, photons=photons)
    how, said = algorithm.choose(flatten(cornell_box((8, 8))), settings)
    chosen = replace(settings, indirect=how)
    assert chosen.indirect is not Indirect.AUTO
    assert indirect in (Indirect.AUTO, chosen.indirect)
    assert said is None or indirect is Indirect.AUTO
    light = algorithm.diffuse_light(chosen)
    assert bool(algorithm.traced_by(chosen)) == (light is not DiffuseLight.PHOTON_MAP)
    assert chosen.final_gathers == (light is DiffuseLight.FINAL_GATHER)
    assert algorithm.shoots_photons >= algorithm.maps(chosen).indirect >= algorithm.has_irradiance_cache(chosen)
    kinds = algorithm.kinds_to_try(settings)
    assert len(set(kinds)) == len(kinds) > 0
    assert Indirect.AUTO not in kinds
    assert indirect in (Indirect.AUTO, *kinds)
    assert algorithm.in_words(replace(settings, indirect=kinds[0]))


def test_the_reference_has_no_bias() -> None:
    assert not REFERENCE.algorithm.biased
