"""What a journal is of, and how that differs from what is to be rendered, in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from enum import Enum

from wdpm.cluster.messages.checks import LARGEST_SIDE
from wdpm.cluster.render_settings import CHANGE_NO_BIT
from wdpm.cluster.session import Session
from wdpm.cluster.versions import versions
from wdpm.rendering.pass_plan import PassPlan
from wdpm.rendering.prepare import Prepared, digest

NOT_SETTINGS = frozenset({*CHANGE_NO_BIT, "spp", "passes", "pass_samples"})
"""Of RenderSettings: those that change no bit of a pass, and those that PassPlan stands for."""

_OF_PASS = "samples of each part"
"""The one identity that differs from pass to pass."""


_RECORDS = "irradiance records"

_SEVERAL = (_OF_PASS, _RECORDS)
"""Names that stand for more than one thing, besides settings."""


@dataclass(frozen=True)
class JournalHead:
    """What a journal is of.

    Attributes:
        identity: digests, by name (Prepared.identity), and that of irradiance records that were loaded.
        settings: in words, by name, to tell what differs.
        versions: what bits depend on besides.
        number, first_sample, spp: of the pass.
        width, height: of the image [pixels].
        channels: name of layer -> 1 or 3.
        bucket: side of a bucket [pixels]; another number of slaves may have chosen another.
    """

    identity: dict[str, str]
    settings: dict[str, str]
    versions: dict[str, str]
    number: int
    first_sample: int
    spp: int
    width: int
    height: int
    channels: dict[str, int]
    bucket: int

    @property
    def sound(self) -> bool:
        """Whether its side of a bucket is one; what else it holds is compared."""
        return 1 <= self.bucket <= LARGEST_SIDE


def head_of(prepared: Prepared, session: Session, plan: PassPlan) -> JournalHead:
    """Of a pass that is to be rendered."""
    camera = session.view.camera
    loaded = {_RECORDS: digest(session.records), _OF_PASS: digest(session.view.allotment)}
    return JournalHead(
        {**prepared.identity, **loaded},
        settings_in_words(prepared),
        versions(),
        plan.number,
        plan.first_sample,
        plan.spp,
        camera.width,
        camera.height,
        dict(session.layers),
        session.view.bucket,
    )


def settings_in_words(prepared: Prepared) -> dict[str, str]:
    """Those that the bits of a pass depend on, by name."""
    return {
        name: str(value.value if isinstance(value, Enum) else value)
        for name, value in asdict(prepared.settings).items()
        if name not in NOT_SETTINGS
    }


def is_of_later_pass(before: JournalHead, now: JournalHead) -> bool:
    """Whether a journal is of a later pass of the very image that is to be rendered."""
    samples = {_OF_PASS: now.identity.get(_OF_PASS, "")}
    moved = replace(
        before,
        identity={**before.identity, **samples},
        number=now.number,
        first_sample=now.first_sample,
        spp=now.spp,
    )
    return before.number > now.number and not differences(moved, now)


def differences(before: JournalHead, now: JournalHead) -> list[str]:
    """What a journal is of that is not to be rendered, in words; empty if it can be gone on with."""
    found = []
    if before.versions != now.versions:
        found += [f"another version ({', '.join(changed_settings(before.versions, now.versions))})"]
    found += other_parts(before.identity, now.identity, list(changed_settings(before.settings, now.settings)))
    if (before.number, before.first_sample, before.spp) != (now.number, now.first_sample, now.spp):
        found += [f"{_samples(before)}, where {_samples(now)} is next"]
    layers = (before.width, before.height, before.channels) != (now.width, now.height, now.channels)
    return found or (["an image of other layers, or of another size"] if layers else [])


def other_parts(before: Mapping[str, str], now: Mapping[str, str], settings: Sequence[str]) -> Iterator[str]:
    """How what a journal is of is not what is to be rendered.

    Args:
        before, now: Prepared.identity, or more than that.
        settings: that have changed, each in words.
    """
    changed = [name for name, value in now.items() if before.get(name) != value]
    for name in changed:
        if name == "settings":
            if "scene" not in changed:  # some are chosen by the scene: they would be blamed in its place
                yield f"other settings ({', '.join(settings)})" if settings else "other settings"
        elif name == "scene" and "camera" in changed:  # the scene's extent goes by where the camera stands
            yield "perhaps another scene"
        else:
            yield f"other {name}" if name in _SEVERAL else f"another {name}"


def changed_settings(before: Mapping[str, str], now: Mapping[str, str]) -> Iterator[str]:
    """What was otherwise, by name, each in words."""
    for name in sorted(before.keys() | now.keys()):
        if before.get(name) != now.get(name):
            yield f"{name} {before.get(name, 'none'):.40} where {now.get(name, 'none'):.40} is asked for"


def _samples(head: JournalHead) -> str:
    return f"pass {head.number + 1} of samples {head.first_sample} to {head.first_sample + head.spp - 1}"
