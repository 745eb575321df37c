"""What a sweep means, in sentences: where the error comes from, and which knob to turn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from wdpm.accuracy.result import WORST, Accuracy, CurveFigures
from wdpm.cluster.render_settings import Integrator

MATTERS = 0.1
"""A change of time or error that is worth a word, as a share."""

BUSY = 1.3
"""Wall-clock time over CPU time of all cores from which on a machine was busy with other things."""

CONCENTRATED = 0.5
"""Share of the error, in few pixels, that is worth a word."""

SHAKY = 0.25
"""Noise of the reference above this share of the smallest error makes that one uncertain."""


@dataclass(frozen=True)
class Offer:
    """A point of a curve, as seen from its base.

    Attributes:
        word, base_word: values of the knob.
        time, error: over the base's.
        nearer, farther: whether the error is smaller, or larger, by more than chance.
        faster: whether every seed took less time than any of the base.
    """

    curve: CurveFigures
    word: str
    base_word: str
    time: float
    error: float
    nearer: bool
    farther: bool
    faster: bool

    @property
    def is_free(self) -> bool:
        """Better, and not slower."""
        return self.nearer and self.error < 1 - MATTERS and self.time < 1 + MATTERS / 2

    @property
    def is_bought(self) -> bool:
        """Better, and slower."""
        return self.nearer and self.error < 1 - MATTERS and not self.is_free

    @property
    def is_saving(self) -> bool:
        """Faster, and hardly worse."""
        return self.faster and self.time < 1 - MATTERS and self.error < 1 + MATTERS / 2 and not self.farther

    @property
    def power(self) -> float:
        """p in error ~ 1 / time^p; meaningful for what is bought."""
        return -math.log(self.error) / math.log(self.time)

    def in_words(self) -> str:
        """`photons 1M instead of 250k (0.62 times the error in 1.31 times the time)`."""
        change = f"{self.error:.2f} times the error in {self.time:.2f} times the time"
        return f"{self.curve.label} {self.word} instead of {self.base_word} ({change})"


def summary(found: Accuracy) -> list[str]:
    """The first paragraph: sentences, the first of which says what to do."""
    offers = offers_of(found)
    return [*_what_to_do(offers), _where_from(found), *_no_use(offers), *_from_the_front(found)]


def warnings(found: Accuracy) -> list[str]:
    """What makes figures uncertain."""
    found_wanting = []
    noise, least = found.reference_noise, min(point.rel_mse.error.value for point in found.points)
    if noise is not None and noise > SHAKY * max(least, 0.0):
        found_wanting.append(
            f"The reference's own noise is a relMSE of {noise:.2g}, and the smallest error found is {least:.2g}: it is "
            "subtracted, but makes small errors uncertain. A longer --reference-time would help."
        )
    if found.worst > CONCENTRATED and not found.trim:
        found_wanting.append(
            f"{found.worst:.0%} of the base's error lies in {WORST:.1%} of the pixels: edges of lamps, highlights, "
            "what the reference missed. Figures tell most about these, and vary with chance: "
            f"--trim {WORST:g} leaves them out."
        )
    waited = median(point.wall_seconds / point.cpu_seconds for point in found.points if not point.slaves)
    if found.clock == "wall" and waited > BUSY:
        found_wanting.append(
            f"The machine had other work to do: a render took {waited:.1f} times as long as it computed. Times, and "
            "the Pareto front with them, are rough; --clock cpu goes by CPU time instead."
        )
    return found_wanting


def clock_words(found: Accuracy) -> str:
    """What "time" means."""
    return "CPU time" if found.clock == "cpu" else "time"


def band_sentence(found: Accuracy) -> str | None:
    """What the band's curve says; None if it was not turned."""
    curve = found.curve_of("band")
    if curve is None:
        return None
    narrow = [
        found.points[number] for number, value in zip(curve.points, curve.values, strict=True) if _below_one(value)
    ]
    wide = [found.points[n] for n, value in zip(curve.points, curve.values, strict=True) if not _below_one(value)]
    exact = found.points[curve.base]
    equal = all(point.band is not None and point.band.bits_equal for point in wide)
    text = (
        "From a band as wide as the gather radius on, every bit is that of one machine."
        if equal and exact.bits_as_base
        else "At full width bits differ from those of one machine: this is a bug, please report it."
    )
    errors = [(point.band.mse, point.band.max_abs) for point in narrow if point.band is not None]
    if errors:
        worst, largest = max(errors)
        text += f" Narrower ones are off by a mean square of up to {worst:.1e} (largest difference {largest:.2g})."
        least = min(narrow, key=lambda point: point.bytes)
        text += (
            f" Exactness costs {_more(exact.bytes, least.bytes)} traffic and {_more(exact.seconds, least.seconds)} "
            f"time than {least.name}."
        )
    return text


def offers_of(found: Accuracy) -> list[Offer]:
    """Every point but the bases, as seen from the base of its curve; not those of band and slaves."""
    offers = []
    for curve in found.curves:
        if curve.knob in ("band", "slaves"):
            continue
        base = found.points[curve.base]
        for number, word in zip(curve.points, curve.words, strict=True):
            point = found.points[number]
            if number == curve.base or not base.rel_mse.error.value > 0:
                continue
            mine, yours = point.rel_mse.error, base.rel_mse.error
            error = max(mine.value, 1e-9 * yours.value) / yours.value
            offers.append(
                Offer(
                    curve,
                    word,
                    curve.words[curve.points.index(curve.base)],
                    point.seconds / base.seconds,
                    error,
                    nearer=point.gained.high < 0,
                    farther=point.gained.low > 0,
                    faster=max(point.each_seconds) < min(base.each_seconds),
                )
            )
    return offers


def _where_from(found: Accuracy) -> str:
    base, split = found.base, found.base.rel_mse
    settings = base.settings
    samples = _counted(settings["spp"], "sample")
    photons = f"{_counted(settings['photons'], 'photon')}, k {settings['k']} and "
    by_photons = Integrator(settings["integrator"]).algorithm.shoots_photons
    at = f"At the base, {photons if by_photons else ''}{samples},"
    text = f"{at} relMSE is {split.error.value:.2g} in {base.seconds:.1f} s{_of_cpu(found)}"
    if not split.error.value > 0:
        return text + ": no error that these seeds and this reference can show."
    share = min(max(split.noise.value / split.error.value, 0.0), 1.0)
    return (
        f"{text}: {share:.0%} of it is noise, which more samples or photons average out, and {1 - share:.0%} is bias."
    )


def _what_to_do(offers: list[Offer]) -> list[str]:
    sentences = []
    free = sorted((offer for offer in offers if offer.is_free), key=lambda offer: offer.error)
    if free:
        sentences.append(f"One change costs nothing: {free[0].in_words()}.")
    best: dict[str, Offer] = {}
    for offer in sorted((each for each in offers if each.is_bought), key=lambda each: -each.power):
        best.setdefault(offer.curve.knob, offer)
    ranked = list(best.values())
    if ranked:
        first = ranked[0]
        sentences.append(f"What buys most for its time: {first.in_words()}.")
        if len(ranked) > 1:
            sentences.append(f"Then {' and '.join(offer.in_words() for offer in ranked[1:3])}.")
    elif not free:
        sentences.append("No single knob lowers the error by more than chance might; more --seeds would tell.")
    saving = sorted((offer for offer in offers if offer.is_saving and not offer.is_free), key=lambda offer: offer.time)
    if saving:
        sentences.append(f"Time is saved by {saving[0].in_words()}.")
    return sentences


def _no_use(offers: list[Offer]) -> list[str]:
    idle = []
    for label in dict.fromkeys(offer.curve.label for offer in offers):
        of_knob = [offer for offer in offers if offer.curve.label == label]
        if all(abs(offer.error - 1) < MATTERS for offer in of_knob):
            idle.append(label)
    if not idle:
        return []
    return [f"Within the range tried, these hardly matter: {listed(idle)}."]


def _from_the_front(found: Accuracy) -> list[str]:
    best = found.points[found.front[-1]]
    if best.number == 0:
        return ["No point of this sweep has a smaller error than the base."]
    return [
        f"The smallest error, {best.rel_mse.error.value:.2g} in {best.seconds:.1f} s{_of_cpu(found)}, has the point "
        f"“{best.name}”; one knob at a time was turned, and what several do together was not tried."
    ]


def _of_cpu(found: Accuracy) -> str:
    return " of CPU time" if found.clock == "cpu" else ""


def listed(words: Sequence[str]) -> str:
    """`a, b and c`."""
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]


def _below_one(value: float | str) -> bool:
    return not isinstance(value, str) and value < 1


def _more(much: float, little: float) -> str:
    if little <= 0:
        return "more"
    change = much / little - 1
    return f"{change:.0%} more" if change >= 0 else f"{-change:.0%} less"


def _counted(number: int, what: str) -> str:
    return f"{number:,} {what}" + ("s" if number != 1 else "")
