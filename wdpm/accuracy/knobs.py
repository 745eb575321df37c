"""The knobs that `wdpm accuracy` turns, and what `--sweep` says of one: which values it is to take.

A knob is a setting of the render, or the number of slaves. A sweep turns one of them; the others stay at the base.
"""

from __future__ import annotations

import re
from argparse import ArgumentTypeError
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

from wdpm import values
from wdpm.cluster.render_settings import Indirect

Value = int | float | Indirect
"""What a knob is set to."""

MAPS = ("global", "caustic", "volume")
"""The photon maps, in the order of World.maps."""

CLOCKS = ("wall", "cpu")
"""What may count as the time of a point: that of a clock on the wall, or that of all cores together."""

STEPS = 5
"""Values of a range that does not say how many."""

DIGITS = 3
"""To which the whole numbers of a range are rounded, so that commands stay readable."""


class Spacing(Enum):
    """How the values of a range lie between its ends."""

    LOGARITHMIC = "logarithmic"
    LINEAR = "linear"
    NONE = "none"
    """There are no ranges: only lists make sense."""


@dataclass(frozen=True)
class Knob:
    """Something that costs time and buys accuracy, or is thought to.

    Attributes:
        name: as `--sweep` has it: a field of RenderSettings, or "slaves".
        label: for people.
        parse: a value from text; raises ArgumentTypeError.
        spacing: of a range.
        whole: whether values are whole numbers.
        map: the photon map that it belongs to, of MAPS; None for one that belongs to none, or to all.
        factors: whether values may be factors of what the base has, like `0.5x`.
        by_default: whether the default sweep turns it, where the scene has a use for it.
    """

    name: str
    label: str
    parse: Callable[[str], Value]
    spacing: Spacing = Spacing.LOGARITHMIC
    whole: bool = True
    map: str | None = None
    factors: bool = False
    by_default: bool = True

    @property
    def option(self) -> str:
        """As a person types it: light-samples."""
        return self.name.replace("_", "-")

    def in_words(self, value: Value) -> str:
        """A value for people: 250k, 0.5, gather."""
        if isinstance(value, Indirect):
            return value.value
        if isinstance(value, float):
            return f"{value:.4g}"
        for unit, size in (("M", 10**6), ("k", 10**3)):
            if value >= size and value % (size // 1000) == 0:
                return f"{value / size:g}{unit}"
        return f"{value}"


def _indirect(text: str) -> Indirect:
    if text not in (each.value for each in Indirect):
        raise ArgumentTypeError(f"'{text}' must be one of {', '.join(each.value for each in Indirect)}")
    return Indirect(text)


def _length(text: str) -> float:
    number = values.length(text)
    if not 0 < number < float("inf"):
        raise ArgumentTypeError(f"'{text}' is not a positive length in scene units, nor a factor like 0.5x")
    return number


def _share(text: str) -> float:
    number = values.length(text)
    if not 0 <= number < float("inf"):
        raise ArgumentTypeError(f"'{text}' is not a share of the gather radius: expected 0 or more, like 0.5")
    return number


KNOBS = (
    Knob("photons", "photons", values.positive_count, map="global"),
    Knob("k", "k", values.positive_count, map="global"),
    Knob("radius", "radius", _length, whole=False, map="global", factors=True),
    Knob("spp", "samples", values.positive_count),
    Knob("passes", "passes", values.positive_count),
    Knob("light_samples", "light samples", values.positive_count),
    Knob("caustic_photons", "caustic photons", values.positive_count, map="caustic"),
    Knob("caustic_k", "caustic k", values.positive_count, map="caustic", by_default=False),
    Knob("caustic_radius", "caustic radius", _length, whole=False, map="caustic", factors=True, by_default=False),
    Knob("volume_photons", "volume photons", values.positive_count, map="volume"),
    Knob("volume_samples", "volume samples", values.positive_count, map="volume", by_default=False),
    Knob("volume_radius", "volume radius", _length, whole=False, map="volume", factors=True, by_default=False),
    Knob("indirect", "indirect light", _indirect, Spacing.NONE, map="global"),
    Knob("band", "band", _share, Spacing.LINEAR, whole=False),
    Knob("slaves", "slaves", values.count, Spacing.LINEAR),
)
"""All there are, in the order in which they are shown."""


@dataclass(frozen=True)
class Sweep:
    """One knob, and the values that it is to take.

    Attributes:
        values: at least one, no two alike, in growing order (choices: as given).
        factors: whether they are factors of what the base has.
        text: as it was typed; empty for one that nobody typed.
    """

    knob: Knob
    values: tuple[Value, ...]
    factors: bool = False
    text: str = ""

    @property
    def words(self) -> str:
        """What a message calls it: `--sweep k=1..500`."""
        return f"--sweep {self.text}" if self.text else f"sweep of {self.knob.option}"


def photons_of(kind: str) -> str:
    """The setting that says how many photons a map, of MAPS, is to store."""
    return "photons" if kind == "global" else f"{kind}_photons"


def knob_of(name: str) -> Knob:
    """The knob of a name, with - or _. Raises ArgumentTypeError."""
    for knob in KNOBS:
        if knob.name == name.replace("-", "_"):
            return knob
    raise ArgumentTypeError(f"there is no knob '{name}': must be one of {', '.join(knob.option for knob in KNOBS)}")


def parse_sweep(text: str) -> Sweep:
    """`photons=50k..4M`, `photons=50k..4M:7`, `k=20,50,120`, `radius=0.5x..2x` or `band=0..1`.

    Raises:
        ArgumentTypeError: what is wrong with it, in one line.
    """
    name, equals, wanted = text.partition("=")
    if not equals or not name.strip():
        raise ArgumentTypeError(f"'{text}' is not a sweep: expected KNOB=VALUES, like photons=50k..4M or k=20,50,120")
    knob = knob_of(name.strip())
    try:
        return replace(_sweep(knob, wanted.strip()), text=text.strip())
    except ArgumentTypeError as error:
        raise ArgumentTypeError(f"sweep of {name.strip()}: {error}") from None


def make_sweep(knob: Knob, wanted: list[Value], factors: bool = False) -> Sweep:
    """A sweep through these values, in order and each once."""
    unlike = list(dict.fromkeys(wanted))
    if knob.spacing is not Spacing.NONE:
        unlike.sort(key=lambda value: value if not isinstance(value, Indirect) else 0)
    return Sweep(knob, tuple(unlike), factors)


def _sweep(knob: Knob, wanted: str) -> Sweep:
    if not wanted:
        raise ArgumentTypeError("it is empty: expected a range like 1..10 or a list like 1,3,10")
    factors = "x" in wanted and knob.factors
    if factors:
        wanted = _without_x(wanted)
    match = re.fullmatch(r"(.+?)\.\.(.+?)(?::([^:]*))?", wanted)
    if match is None:
        return make_sweep(knob, [knob.parse(each.strip()) for each in wanted.split(",")], factors)
    return make_sweep(knob, _range(knob, match[1], match[2], match[3]), factors)


def _without_x(wanted: str) -> str:
    """All values are factors, or none is; the number of steps is none of them."""
    ends, colon, steps = wanted.partition(":")
    parts = re.split(r"(,|\.\.)", ends)
    for part in parts[::2]:
        if not part.strip().endswith("x"):
            raise ArgumentTypeError(f"'{part}' is no factor like 0.5x, but others are: give all as factors, or none")
    return (
        "".join(part.strip().removesuffix("x") if i % 2 == 0 else part for i, part in enumerate(parts)) + colon + steps
    )


def _range(knob: Knob, first: str, last: str, steps: str | None) -> list[Value]:
    if knob.spacing is Spacing.NONE:
        raise ArgumentTypeError(f"'{first}..{last}' is a range, but its values have no order: give a list")
    low, high = knob.parse(first.strip()), knob.parse(last.strip())
    if isinstance(low, Indirect) or isinstance(high, Indirect) or not low < high:
        raise ArgumentTypeError(f"'{first}..{last}' is not a range: expected the smaller end first")
    count = STEPS
    if steps is not None:
        if not steps.isdecimal() or int(steps) < 2:
            raise ArgumentTypeError(f"':{steps}' is not a number of steps: expected at least 2, like {first}..{last}:5")
        count = int(steps)
    if knob.spacing is Spacing.LOGARITHMIC:
        inner = [low * (high / low) ** (step / (count - 1)) for step in range(1, count - 1)]
    else:
        inner = [low + (high - low) * step / (count - 1) for step in range(1, count - 1)]
    short = (rounded(value, knob.whole) for value in inner)
    return [low, *(value for value in short if low < value < high), high]


def rounded(value: float, whole: bool) -> int | float:
    """To DIGITS digits; a whole number below 10^DIGITS to itself."""
    short = float(f"{value:.{DIGITS}g}")
    return max(round(short), 1) if whole else short
