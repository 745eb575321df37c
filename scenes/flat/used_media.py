"""Whether light may travel in a medium."""

from __future__ import annotations

import numpy as np

from wdpm.scenes.flat.flatten import FlatScene


def calls_for_media(flat: FlatScene) -> bool:
    """Whether some light may travel in a medium."""
    bounded = flat.materials.medium[np.unique(flat.triangles.material)]
    around = [flat.camera.medium is not None, bool((flat.lights.medium >= 0).any())]
    return bool((bounded >= 0).any()) or any(around)
