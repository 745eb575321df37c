"""Light that hardly a path of a trial has found, though photons tell of it: how noisy an image by paths then is.

Round two bends one path in ten thousand finds the lamp. A trial of some thousands has seen one of them or none: its
picture is black, and without any noise. That is no reason for path tracing. What so few of n have found, one sample
finds with a probability of (found + UNSEEN) / n at most, so it comes as rarely, and as many times too bright; how much
light it is the pilot's photons tell.

Round two short bends one in a hundred finds light, most of them next to none, and some of them most of all that there
is. So pixels that have found light say little of their own noise: most are black, what is bright is taken to be light
that is there, and the brightest to be chance (small_view). How unlike each other they are tells it: if all were as
bright, E[x²] / E[x]² would be n / found, and it is the more the fewer of them bring most of the light.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.plan.map_worth import UNSEEN, MapError
from wdpm.cluster.plan.small_view import Figures
from wdpm.cluster.plan.trial.looks import Looks

ENOUGH = 0.125
"""Share of the pixels of a trial which see what photons tell of, from which on these tell how noisy paths are, if paths
have found light in so many."""


def is_dark(looks: Looks) -> bool:
    """Whether paths have found next to nothing where photons may tell of light."""
    return _is_rare(_where_photons_tell(looks, "beauty"))


def with_unfound(looks: Looks, of_global: MapError | None) -> Figures:
    """Figures of path tracing, with what it has yet to find.

    Args:
        of_global: of the global map, where the camera sees it.
    """
    figures, indirect = looks.by_paths, _where_photons_tell(looks, "indirect")
    if of_global is None or not _is_rare(indirect):
        return figures
    light = float(of_global.squares.mean())
    noise = light * (looks.samples // 2) * _variance(indirect)
    return replace(
        figures,
        noise=max(figures.noise, noise),
        of_indirect=max(figures.of_indirect, noise),
        indirect=max(figures.indirect, light),
    )


def _where_photons_tell(looks: Looks, layer: str) -> NDArray[np.float64]:
    """Light that paths have found in the pixels of both halves that see what photons tell of."""
    seen = np.unique(looks.places.all("pixel"))
    return np.concatenate([half[layer].mean(axis=2).reshape(-1)[seen] for half in looks.paths.layers])


def _is_rare(light: NDArray[np.float64]) -> bool:
    return int((light > 0.0).sum()) < ENOUGH * len(light)


def _variance(light: NDArray[np.float64]) -> float:
    """Of the rare light of some pixels, over its square: as much as it is rare, and unlike where it is found."""
    found = light[light > 0.0]
    rare = len(light) / (len(found) + UNSEEN)
    unlike = float((found**2).mean() / found.mean() ** 2) if len(found) else 1.0
    return max(rare * unlike - 1.0, 0.0)
