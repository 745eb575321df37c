"""Schlick's weight of a direction, which tells light that grazes a surface from light that comes from above.

Interfaces reflect F(cos) = F0 + (1 - F0) (1 - cos)^5, nearly (Schlick 1994, "An Inexpensive BRDF Model for
Physically-based Rendering"). So of the light that a surface gets one number besides its irradiance E tells most of what
a coat lets through, or a rough base sends back: how much it grazes,

    grazing = (integral of (1 - cos)^5 L cos over the hemisphere) / E - 1/21.

Of light that comes alike from all sides it is 0.
"""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

EVEN_SCHLICK = wp.constant(wp.float32(1.0 / 21.0))
"""Mean of Schlick's weight over light that comes alike from all sides."""


@wp.func
def schlick_weight(cos: wp.float32) -> wp.float32:
    """(1 - cos)^5, the cosine clamped to [0, 1]."""
    m = wp.clamp(1.0 - cos, 0.0, 1.0)
    m2 = m * m
    return m2 * m2 * m
