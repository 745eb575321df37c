"""What a render by default chooses, for a time that is to be spent as it would be.

Where all is matt, light between surfaces comes by irradiance records. Passes of one sample make their own of few rays
each; a few passes of many samples have far less noise after the same time. Where something mirrors or refracts, neither
is always better, and nothing here tells which: docs/accuracy.md has figures.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.rendering.passes import PassRenderer
from wdpm.scenes.model.bsdfs import Leaf, walk
from wdpm.scenes.model.scene import Scene

SAMPLES_OF_CHOICE = 16
"""Of a pixel, that it chooses for where nobody knows yet how many there will be."""

CHOICE_SHARE = 0.15
"""Of a time budget, what that may take: the first pass by it, and to begin again with its samples, take two to three
times as long."""


@dataclass(frozen=True)
class Chosen:
    """What came of it.

    Attributes:
        settings: None where they are not by records, or there was no time.
        why: in words.
        compile_seconds: that went by for compiling.
    """

    settings: RenderSettings | None
    why: str
    compile_seconds: float


def choose_by_default(
    renderer: Callable[[RenderSettings], PassRenderer], settings: RenderSettings, seconds_left: Callable[[], float]
) -> Chosen:
    """Prepare a render by default, and keep what it chose.

    Args:
        renderer: makes one of settings.
        settings: that leave the integrator open.
        seconds_left: until a time budget is used up.
    """
    whole = seconds_left()
    prepared = renderer(replace(settings, spp=SAMPLES_OF_CHOICE, passes=1)).prepared
    found, compiling = prepared.settings, prepared.seconds["compile"]
    late = whole - seconds_left() - compiling > CHOICE_SHARE * whole
    if late or found.indirect is not Indirect.CACHE:
        return Chosen(None, "", compiling)
    chosen = replace(settings, integrator=found.integrator, indirect=found.indirect, light_samples=found.light_samples)
    return Chosen(chosen, prepared.chose[0], compiling)


def is_matt(scene: Scene) -> bool:
    """Whether all light is scattered by diffuse surfaces: nothing mirrors, refracts, or scatters in between."""
    leaves = [node for material in scene.materials for node in walk(material.bsdf) if isinstance(node, Leaf)]
    return not scene.media and not any(leaf.KIND.glossy for leaf in leaves)
