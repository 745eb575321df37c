"""Indices of refraction by name, as Mitsuba's dielectric plugins know them.

Source: the table of Mitsuba 3's `dielectric` documentation; most values are from Hecht, "Optics", 4th edition, measured
between 0 and 20 degrees Celsius at about 589 nm.
"""

from __future__ import annotations

from typing import Final

INDICES: Final[dict[str, float]] = {
    "vacuum": 1.0,
    "helium": 1.000036,
    "hydrogen": 1.000132,
    "air": 1.000277,
    "carbon dioxide": 1.00045,
    "water": 1.333,
    "acetone": 1.36,
    "ethanol": 1.361,
    "carbon tetrachloride": 1.461,
    "glycerol": 1.4729,
    "benzene": 1.501,
    "silicone oil": 1.52045,
    "bromine": 1.661,
    "water ice": 1.31,
    "fused quartz": 1.458,
    "pyrex": 1.47,
    "acrylic glass": 1.49,
    "polypropylene": 1.49,
    "bk7": 1.5046,
    "sodium chloride": 1.544,
    "amber": 1.55,
    "pet": 1.575,
    "diamond": 2.419,
}
"""Lower-case names; Mitsuba does not tell capitals from small letters."""
