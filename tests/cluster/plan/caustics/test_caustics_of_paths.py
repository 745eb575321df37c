"""Where paths are guided to caustics: where photons tell of small bright ones, and nowhere else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirrored_lamp import IMAGE, mirrored
from window_room import constant_sky

from wdpm.cluster.guide import CausticGuide
from wdpm.cluster.plan.caustics import guide
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.kernels.launch import Launcher
from wdpm.progress import SilentProgress
from wdpm.rendering.prepare import prepare
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Scene

PATH = RenderSettings(integrator=Integrator.PATH, all_effects=True)


def guide_of(scene: Scene, chosen: RenderSettings = PATH, threads: int = 1, cells: int = 1) -> CausticGuide:
    """What a render of a scene learns."""
    return prepare(scene, chosen, 1, Launcher("cpu", threads), SilentProgress(), cells).session.view.caustic_guide


def test_lobes_of_a_mirror_lead_to_the_lamp_behind_it() -> None:
    scene = mirrored()
    found = guide_of(scene)
    assert len(found) >= 2
    flat = flatten(scene)
    middle = np.median(found.target, axis=0) * flat.unit + flat.center
    np.testing.assert_allclose(middle, IMAGE.mean(axis=0), atol=0.05)
    assert np.median(found.rim) < 1e-3


@pytest.mark.parametrize(("radiance", "alpha", "guided"), [(40.0, 0.03, True), (40.0, 0.6, False), (0.4, 0.03, False)])
def test_of_metals_under_a_sky_those_that_mirror_a_bright_lamp_are_guided_to(
    radiance: float, alpha: float, guided: bool
) -> None:
    """A dull metal scatters what comes of it all over the place; and a lamp as bright as the sky makes no noise."""
    scene = replace(mirrored(alpha, radiance=radiance), lights=(constant_sky(),))
    assert bool(len(guide_of(scene))) == guided


def without_lamp(alpha: float = 0.0) -> Scene:
    scene = mirrored(alpha)
    return replace(scene, meshes=scene.meshes[:2], lights=(PointLight("point", (-0.2, 1.0, 0.0), (1.0, 1.0, 1.0)),))


def test_of_lights_without_extent_those_in_rough_metals_are_guided_to() -> None:
    """Shadow rays find them from there, and from nothing else that is glossy."""
    assert len(guide_of(without_lamp(0.05)))
    assert not len(guide_of(without_lamp()))


@pytest.mark.parametrize(
    ("scene", "chosen"),
    [
        (cornell_box((24, 16)), PATH),
        (without_lamp(), PATH),
        (mirrored(), replace(PATH, max_depth=2)),
        (mirrored(), replace(PATH, integrator=Integrator.PHOTONS)),
        (mirrored(radiance=0.0), PATH),
    ],
    ids=["no metal", "a lamp no path meets", "too short paths", "photons", "dark"],
)
def test_elsewhere_there_is_no_guide(scene: Scene, chosen: RenderSettings) -> None:
    assert not len(guide_of(scene, chosen))


def test_it_is_the_same_whatever_the_cluster() -> None:
    one, other = guide_of(mirrored(0.03)), guide_of(mirrored(0.03), threads=3, cells=8)
    for name, column in vars(one).items():
        assert column.tobytes() == getattr(other, name).tobytes(), name


def test_what_it_leaves_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    moments = []
    moment = guide._moment

    def told(*arguments: object) -> tuple[float, guide.Untaught]:
        left, untaught = moment(*arguments)  # type: ignore[arg-type]
        moments.append(left)
        return left, untaught

    monkeypatch.setattr(guide, "_moment", told)
    assert len(guide_of(mirrored(0.03)))
    monkeypatch.setattr(guide, "WORTH", moments[0] * 0.99)
    assert not len(guide_of(mirrored(0.03)))
