"""Limits that hosts check without Warp, whose import takes half a second."""

from __future__ import annotations

from typing import Final

MAPS: Final = 3
"""Photon maps: global, caustic, volume, in the order of kernels.photon_paths."""

CHAIN_LIMIT: Final = 1024
"""Vertices of a camera path: Russian roulette ends nearly all long before; what this bound cuts off is reported."""
