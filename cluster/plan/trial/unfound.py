"""Light that hardly a path of a trial has found, though photons tell of it: how noisy an image by paths then is.

Round two bends one path in ten thousand finds the lamp. A trial of some thousands has seen one of them or none: its
picture is black, and without any noise. That is no reason for path tracing. What so few of n have found, one sample
finds with a probability of (found + UNSEEN) / n at most, so it comes as rarely, and as many times too bright; how much
light it is the pilot's photons tell.
"""

from __future__ import annotations

from dataclasses import replace

from wdpm.cluster.plan.map_worth import UNSEEN, MapError
from wdpm.cluster.plan.small_view import Figures
from wdpm.cluster.plan.trial.looks import Looks

ENOUGH = 32
"""Pixels of a trial in which paths have found light, from which on these tell how noisy it is."""


def is_dark(looks: Looks) -> bool:
    """Whether paths have found next to nothing."""
    return _found(looks) < ENOUGH


def with_unfound(looks: Looks, of_global: MapError | None) -> Figures:
    """Figures of path tracing, with what it has yet to find.

    Args:
        of_global: of the global map, where the camera sees it.
    """
    figures = looks.by_paths
    if of_global is None or not is_dark(looks):
        return figures
    light = float(of_global.squares.mean())
    pixels = sum(half["beauty"].mean(axis=2).size for half in looks.paths.layers)
    noise = light * (looks.samples // 2) * max(pixels / (_found(looks) + UNSEEN) - 1.0, 0.0)
    return replace(
        figures,
        noise=max(figures.noise, noise),
        of_indirect=max(figures.of_indirect, noise),
        indirect=max(figures.indirect, light),
    )


def _found(looks: Looks) -> int:
    """Pixels of both halves in which paths have found light."""
    return sum(int((half["beauty"].max(axis=2) > 0.0).sum()) for half in looks.paths.layers)
