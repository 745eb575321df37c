"""Fuzz the wire: lies of strangers, slaves and masters, through packing and checks into the state machines.

Whoever lies, honest processes neither crash nor hang nor fill their memory. A stranger changes nothing at all: the
image has its bits. A slave that lies about anything but pixels can end the render with an error, or have it wait for
ever, but not change the image.
"""

from __future__ import annotations

import random
import resource
import time
import traceback

import numpy as np
from fake_worker import picture
from fuzz_failure import Failure
from wire_cluster import MASTER, STRANGER, Outcome, WireCluster

SLAVES = 2

MOST_CPU_S = 5.0
"""Of one case, which takes a tenth of a second: headers that take long to read are hangs."""

MOST_MEMORY = 1 << 28
"""That a case may take besides what its process has taken before [bytes]."""


def run_case(number: int) -> tuple[int, list[Failure]]:
    """One render with one liar, in bounded time and memory. Returns how many lies were told, and what went wrong."""
    began, before = time.process_time(), _peak()
    lies, wrong = run_unmeasured(number)
    if time.process_time() - began > MOST_CPU_S:
        wrong.append(Failure(f"it took {time.process_time() - began:.1f} s"))
    if (taken := _peak() - before) > MOST_MEMORY:
        wrong.append(Failure(f"it took {taken >> 20} MiB"))
    return lies, wrong


def run_unmeasured(number: int) -> tuple[int, list[Failure]]:
    """The same case for tests, which run on slow machines, beside others, and in processes with other threads."""
    rng = random.Random(number)
    liar = rng.choice((STRANGER, STRANGER, MASTER, *range(SLAVES)))
    cluster = WireCluster(rng, SLAVES, liar, rate=5.0 if liar == STRANGER else rng.choice((0.01, 0.05, 0.3)))
    try:
        outcome = cluster.run()
    except Exception:  # whatever it is: nobody's lies may have that effect
        return 1, [Failure(f"a crash: {traceback.format_exc(limit=-6)}")]
    return outcome.lies, [] if (reason := judge(cluster, outcome, liar)) is None else [Failure(reason)]


def _peak() -> int:
    """The most memory that this process has had [bytes]."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def judge(cluster: WireCluster, outcome: Outcome, liar: int) -> str | None:
    """What is wrong with the outcome of a render, or None."""
    if liar == STRANGER and outcome.result is None:
        return f"a stranger ended the render: {outcome.broken or outcome.exits or 'it waits'}"
    if outcome.result is None or liar == MASTER or outcome.content:
        return None
    for name, layer in picture(cluster.session.view).layers.items():
        if not np.array_equal(outcome.result.layers[name], layer):
            return f"the layer {name} is wrong, and nobody said so"
    return None
