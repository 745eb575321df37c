"""Limits that hosts check without Warp, whose import takes half a second."""

from __future__ import annotations

from typing import Final

MAPS: Final = 3
"""Photon maps: global, caustic, volume, in the order of kernels.photons.deposits."""

CHAIN_LIMIT: Final = 1024
"""Vertices of a camera path: Russian roulette ends nearly all long before; what this bound cuts off is reported."""


MAX_K = 500
"""Largest k: a gather's candidates have a fixed place on the stack. A larger k only blurs; more photons do not."""
