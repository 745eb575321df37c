"""Renders by commands: processes of their own, with the settings of a configuration."""

from __future__ import annotations

import random
import sys

from trials import SIZE, Configuration, scene_names

from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.render_settings import Indirect, Routing


def command(*words: str) -> list[str]:
    """wdpm as a process runs it."""
    return [sys.executable, "-m", "wdpm", *words]


def drawn(chance: random.Random, number: int) -> Configuration:
    """What a command renders: scenes that have a name, the way by chance."""
    ways = [Indirect.CACHE, Indirect.MAP], [1, 2], list(Routing), list(Copies)
    indirect, passes, routing, copies = (chance.choice(each) for each in ways)
    scene = (scene_names()[0], "cornell-box")[number % 2]
    return Configuration(scene, indirect.value, passes, routing.value, copies.value)


def options_of(what: Configuration) -> list[str]:
    """Options of a command that renders a configuration."""
    names = {**what.chosen, "size": "x".join(map(str, SIZE)), "copies": what.copies}
    return [f"--{name.replace('_', '-')}={getattr(value, 'value', value)}" for name, value in names.items()]
