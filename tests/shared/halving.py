"""Images made smaller by whole pixels: what a small render is compared with."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def halved(pixels: NDArray[Any]) -> NDArray[np.float64]:
    """Means of 2 x 2 pixels, in double."""
    height, width, channels = pixels.shape
    blocks = pixels.astype(np.float64).reshape(height // 2, 2, width // 2, 2, channels)
    return np.asarray(blocks.mean(axis=(1, 3)))
