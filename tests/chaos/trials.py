"""What is rendered under faults, and what came of it: rows of a file that a run of hours can go on with."""

from __future__ import annotations

import json
import os
import random
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import wdpm
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.render_settings import Indirect, Routing
from wdpm.images.image import Image
from wdpm.scenes.model.scene import Scene

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "helpers"))

from effect_scenes import everything

SCALE = int(os.environ.get("CHAOS_SCALE", "1"))
"""How many times as wide and high images are, with as many times more photons as pixels: what a fault costs is mostly a
second or two, which is much of a short render and little of a long one."""

SIZE = (32 * SCALE, 32 * SCALE)
FEW = {
    "photons": 4000 * SCALE**2,
    "caustic_photons": 2000 * SCALE**2,
    "volume_photons": 2000 * SCALE**2,
    "spp": 2,
    "k": 30,
    "caustic_k": 30,
}
"""Settings that make a render take seconds; the bucket leaves some sixteen tasks, a few for each slave."""

BUCKET = 8 * SCALE

CHEAP_OFTEN = (3, 1)
"""A render with a cache and without copies takes five times as long as one that looks into the map."""


@cache
def scene_of(name: str, size: tuple[int, int] = SIZE) -> Scene:
    """A scene of the run: one with every effect, and a building."""
    if name == "every effect":
        scene = everything()
        return replace(scene, camera=replace(scene.camera, width=size[0], height=size[1]))
    return wdpm.load(name, size=size)


def scene_names() -> tuple[str, str]:
    """The building is Sponza where the shared scenes are."""
    sponza = Path(os.environ.get("WDPM_SCENES", "")) / "sponza" / "scene.xml"
    return (str(sponza) if "WDPM_SCENES" in os.environ and sponza.exists() else "atrium:20k"), "every effect"


@dataclass(frozen=True)
class Configuration:
    """What is rendered, and by which way of sharing it out."""

    scene: str
    indirect: str
    passes: int
    routing: str
    copies: str

    @property
    def picture(self) -> tuple[str, str, int]:
        """What the bits depend on."""
        return self.scene, self.indirect, self.passes

    @property
    def chosen(self) -> dict[str, Any]:
        """As settings by name."""
        return {
            **FEW,
            "bucket": BUCKET,
            "indirect": Indirect(self.indirect),
            "passes": self.passes,
            "routing": Routing(self.routing),
        }

    def __str__(self) -> str:
        scene = Path(self.scene).parent.name if self.scene.endswith(".xml") else self.scene
        return f"{scene}, {self.indirect}, {self.passes} passes, {self.routing}, copies {self.copies}"


def chosen_by(chance: random.Random, number: int) -> Configuration:
    """The configuration of a render: scenes and copies take turns, the rest is drawn."""
    return Configuration(
        scene_names()[number % 2],
        chance.choices([Indirect.MAP, Indirect.CACHE], CHEAP_OFTEN)[0].value,
        chance.choice([1, 2]),
        chance.choice(list(Routing)).value,
        list(Copies)[number // 2 % 2].value,
    )


@dataclass(frozen=True)
class Trial:
    """One render.

    Attributes:
        kind: of its faults; "none" for an undisturbed one.
        number: of the kind, from 0.
        happened: faults, and when.
        seconds, cpu_s: wall-clock time, and CPU time of all processes but for the starts of new ones [s].
        start_up_s: CPU time of slaves that began meanwhile until they were ready to work [s].
        base_seconds, base_cpu_s: of the undisturbed render of the same configuration in the same run [s].
        redone: finished buckets and rounds of records that were done a second time.
        error: why there is no image, or which bits; empty if they are those of one process.
    """

    kind: str
    number: int
    configuration: Configuration
    happened: tuple[str, ...] = ()
    seconds: float = 0.0
    cpu_s: float = 0.0
    start_up_s: float = 0.0
    base_seconds: float = 0.0
    base_cpu_s: float = 0.0
    redone: int = 0
    error: str = ""

    @property
    def price(self) -> float:
        """CPU time over that of the undisturbed render."""
        return self.cpu_s / self.base_cpu_s


class Rows:
    """A file with a trial a line.

    Args:
        resume: keep what is in it.
    """

    def __init__(self, path: Path, *, resume: bool) -> None:
        self._path = path
        self.trials: list[Trial] = list(_read(path)) if resume and path.exists() else []
        path.parent.mkdir(parents=True, exist_ok=True)
        if not self.trials:
            path.write_text("")

    def add(self, trial: Trial) -> None:
        """One more, on the disk at once."""
        self.trials.append(trial)
        with self._path.open("a") as file:
            file.write(json.dumps(asdict(trial)) + "\n")

    def of(self, kind: str) -> list[Trial]:
        """Those of a kind of fault."""
        return [trial for trial in self.trials if trial.kind == kind]


def _read(path: Path) -> Iterator[Trial]:
    for line in path.read_text().splitlines():
        row = json.loads(line)
        row |= {"configuration": Configuration(**row["configuration"]), "happened": tuple(row["happened"])}
        yield Trial(**row)


@cache
def expected(scene: str, indirect: str, passes: int) -> str:
    """The digest of what one process renders."""
    return digest_of(wdpm.render(scene_of(scene), **_plain(scene, indirect, passes)))


def _plain(scene: str, indirect: str, passes: int) -> dict[str, Any]:
    chosen = Configuration(scene, indirect, passes, Routing.FORWARD.value, Copies.NONE.value).chosen
    return {**chosen, "bucket": max(SIZE)}


def digest_of(image: Image) -> str:
    """Of all layers but the one that names the partition."""
    return Image({name: layer for name, layer in image.layers.items() if name != "cell"}).digest()
