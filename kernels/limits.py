"""Limits that hosts check without Warp, whose import takes half a second."""

from __future__ import annotations

from typing import Final

MAPS: Final = 3
"""Photon maps: global, caustic, volume, in the order of kernels.photons.deposits."""

CHAIN_LIMIT: Final = 1024
"""Vertices of a camera path: Russian roulette ends nearly all long before; what this bound cuts off is reported."""


RAY_SAMPLES: Final = 1 << 30
"""Gather rays of irradiance records have sample numbers from here on: no camera sample has."""

FURTHER_RAYS: Final = 1 << 29
"""Number of the first of a record's further rays, after those of its strata, of which there are fewer."""


POINTS_A_PHOTON: Final = 2
"""Surface points a photon: their count then adds little to the noise of the photons' own."""

POINTS_LEAST: Final = 1 << 16
POINTS_MOST: Final = 1 << 24
"""Bounds to the number of surface points: 28 bytes each."""

MAX_K = 500
"""Largest k: a gather's candidates have a fixed place on the stack. A larger k only blurs; more photons do not."""

MOST_CAUSTIC_SHARE: Final = 64
"""Samples of a pixel for which one asks the caustic map, at most: with more nothing is left to save."""

MAX_PHOTONS = 2**31 - 1
"""Photons of the global or caustic map that may be asked for: their numbers are an int32."""

MAX_VOLUME_PHOTONS = 2**22
"""Volume photons of one image that may be asked for. An int64 holds the sum of twice as many contributions to a beam,
of which none exceeds 2^EXACT_SUM_BITS units (kernels.photons.beam), and a few more are stored than were asked for."""
