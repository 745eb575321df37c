"""Renders under faults of one kind after another, with an undisturbed one of each configuration to compare with."""

from __future__ import annotations

import random
import time
import traceback
from collections.abc import Iterator, Sequence

import early
import full_disk
import masters
from standing import Hung, StandingCluster
from strikes import KINDS, Strikes
from trials import Configuration, Rows, Trial, chosen_by, expected

OTHERS = {"masters": masters.trial, "disk": full_disk.trial, "early": early.trial}
"""Kinds whose renders are processes of their own: number, seed -> trial."""

MISSED = 20
"""Times in a row that a strike may come too late before something is wrong."""


class Campaign:
    """Renders under faults of a kind, after those that are in the rows already.

    Attributes:
        bases: undisturbed renders of this run.
    """

    def __init__(self, rows: Rows, seed: int) -> None:
        self._rows, self._seed = rows, seed
        self._bases: dict[Configuration, Trial] = {trial.configuration: trial for trial in rows.of("none")}
        self._missed = 0

    def trials(self, name: str, count: int) -> Iterator[Trial]:
        """Those that are missing of a kind."""
        numbers = range(len(self._rows.of(name)), count)
        if name in OTHERS:
            yield from (OTHERS[name](number, self._seed) for number in numbers)
        elif numbers:
            yield from self._struck(name, numbers)

    def _struck(self, name: str, numbers: Sequence[int]) -> Iterator[Trial]:
        left = list(numbers)
        while left:
            with StandingCluster(KINDS[name].link) as cluster:
                sound = True
                while left and sound:
                    for trial in self._one(cluster, name, left[0]):
                        sound = not trial.error
                        left = left[trial.kind == name :]
                        yield trial

    def _one(self, cluster: StandingCluster, name: str, number: int) -> Iterator[Trial]:
        """A render under faults, with an undisturbed one before it where there is none of its configuration.

        A strike that came too late is none, and another is drawn.
        """
        kind = KINDS[name]
        what = chosen_by(random.Random(f"{self._seed} {name} {number}"), number)
        if kind.link is None and what not in self._bases:
            undisturbed = Strikes(cluster, KINDS["none"], random.Random(0), 1.0)
            self._bases[what] = _rendered(cluster, "none", len(self._bases), what, undisturbed)
            yield self._bases[what]
        base = self._bases.get(what)
        strikes = Strikes(cluster, kind, random.Random(f"{self._seed} {name} {number} {self._missed}"), _base_cpu(base))
        trial = _rendered(cluster, name, number, what, strikes, base)
        if kind.signal is None or trial.happened or trial.error:
            self._missed = 0
            yield trial
            return
        self._missed += 1
        if self._missed > MISSED:
            raise Hung(f"{name} {number}: {MISSED} strikes in a row came too late")


def _base_cpu(base: Trial | None) -> float:
    return 4.0 if base is None else base.base_cpu_s


def _rendered(
    cluster: StandingCluster, kind: str, number: int, what: Configuration, strikes: Strikes, base: Trial | None = None
) -> Trial:
    wanted = expected(*what.picture)
    began = time.monotonic()
    try:
        cluster.complete()
        cluster.warm_up(what)
        with strikes.meanwhile():
            found = cluster.render(what, KINDS[kind].longest_s)
    except Exception as error:  # whatever went wrong is what this is for: it goes into the row
        text = f"{type(error).__name__}: {error}"
        traceback.print_exc()
        return Trial(kind, number, what, tuple(strikes.happened), time.monotonic() - began, error=text)
    base_s, base_cpu = (found.seconds, found.cpu_s) if base is None else (base.base_seconds, base.base_cpu_s)
    return Trial(
        kind,
        number,
        what,
        tuple(strikes.happened),
        found.seconds,
        found.cpu_s,
        found.start_up_s,
        base_s,
        base_cpu,
        found.redone,
        "" if found.digest == wanted else f"bits differ: {found.digest}, of one process {wanted}",
    )
