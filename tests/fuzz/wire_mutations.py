"""Messages as an enemy would send them: real ones with something wrong, in structure, frames or bits."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from typing import Any

import msgpack
import numpy as np

Frames = list[bytes]

_NUMBERS: tuple[Any, ...] = (-1, 0, 1, 2, 255, 2**31 - 1, 2**31, 2**40, 2**63 - 1, -(2**63), 2**64 - 1)
_FLOATS: tuple[Any, ...] = (0.0, -0.0, -1.0, 1e-320, 1e308, float("inf"), float("-inf"), float("nan"))
_TEXTS: tuple[Any, ...] = (
    "",
    "\x1b[2J\x1b]0;x\x07",
    "a" * 300,
    "a" * 70_000,
    "tcp://10.0.0.1:1",
    "nowhere",
    "tcp://[::1]:99999",
)
_OTHERS: tuple[Any, ...] = (None, True, False, b"", b"\0" * 40, [], {}, [[]] * 50, {"a": 1}, ["<f4", [2**20, 2**20]])

_WORDS = np.array([np.nan, np.inf, -np.inf, -1.0, 1e38], "<f4").view("<u4")
_WHOLE = np.array([0xFFFFFFFF, 0x7FFFFFFF, 0x80000000, 7, 1 << 20], "<u4")


def mutate(frames: Sequence[bytes], rng: random.Random) -> Frames:
    """The frames of a message with one to three things wrong; sometimes with none."""
    changed = [bytes(frame) for frame in frames]
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        changed = rng.choices((_structure, _bits, _frames, _array), (8, 2, 2, 3))[0](changed, rng)
    return changed


def _structure(frames: Frames, rng: random.Random) -> Frames:
    """Another value somewhere in the header, which stays msgpack."""
    try:
        header = msgpack.unpackb(frames[0], raw=False, strict_map_key=False)
    except (ValueError, TypeError, IndexError, RecursionError):  # what an earlier change made of it is no msgpack
        return frames
    places: list[tuple[Any, Any]] = []
    _collect(header, places)
    if not places:
        return frames
    container, key = rng.choice(places)
    container[key] = _other(container[key], rng)
    if isinstance(container, list) and rng.random() < 0.15:
        rng.choice(
            (container.pop, lambda: container.append(1), container.reverse, lambda: container.extend(container))
        )()
    try:
        return [msgpack.packb(header, use_bin_type=True), *frames[1:]]
    except (ValueError, OverflowError, RecursionError):
        return frames


def _collect(value: Any, places: list[tuple[Any, Any]], depth: int = 0) -> None:
    """Everything in lists and maps that can be another; not the depths that an earlier change has made."""
    items = (
        list(value.items()) if isinstance(value, dict) else list(enumerate(value)) if isinstance(value, list) else []
    )
    for key, item in items[:200]:
        places.append((value, key))
        if depth < 20:
            _collect(item, places, depth + 1)


def _other(value: Any, rng: random.Random) -> Any:
    """What may stand in the place of a value: nearly right, right but elsewhere, or nothing of the kind."""
    if isinstance(value, int) and not isinstance(value, bool) and rng.random() < 0.7:
        return rng.choice((value + 1, value - 1, -value, *_NUMBERS))
    if isinstance(value, float) and rng.random() < 0.7:
        return rng.choice((value * 2, -value, *_FLOATS))
    if isinstance(value, str) and value and rng.random() < 0.3:
        at = rng.randrange(len(value))
        return value[:at] + rng.choice("0123456789abcdefg") + value[at + 1 :]
    if isinstance(value, str) and rng.random() < 0.5:
        return rng.choice((value[:-1], value + "x", *_TEXTS))
    if rng.random() < 0.02:
        return _deep(rng.choice((7, 500, 5000)))
    return rng.choice((*_NUMBERS, *_FLOATS, *_TEXTS, *_OTHERS))


def _deep(depth: int) -> Any:
    inner: Any = []
    for _ in range(depth):
        inner = [inner]
    return inner


def _bits(frames: Frames, rng: random.Random) -> Frames:
    """Some bytes of a frame, or its end."""
    if not frames:
        return frames
    place = rng.randrange(len(frames))
    frame = bytearray(frames[place])
    for _ in range(rng.choice((1, 1, 4))):
        if frame:
            frame[rng.randrange(len(frame))] = rng.randrange(256)
    if rng.random() < 0.2:
        frame = frame[: rng.randrange(len(frame) + 1)]
    return [*frames[:place], bytes(frame), *frames[place + 1 :]]


def _frames(frames: Frames, rng: random.Random) -> Frames:
    """A frame too few, too many, or in another place."""
    changed = list(frames)
    place = rng.randrange(len(changed)) if changed else 0
    changes: tuple[Callable[[], Any], ...] = (
        lambda: changed.pop(place) if changed else None,
        lambda: changed.insert(place, rng.randbytes(rng.choice((0, 1, 40, 3000)))),
        lambda: changed.insert(place, changed[place]) if changed else None,
        lambda: rng.shuffle(changed),
        lambda: changed.extend([b""] * rng.choice((1, 10, 2000))),
    )
    rng.choice(changes)()
    return changed


def _array(frames: Frames, rng: random.Random) -> Frames:
    """Numbers of an array that are none, or lie far outside."""
    if len(frames) < 2:
        return _structure(frames, rng)
    place = rng.randrange(1, len(frames))
    words = np.frombuffer(frames[place][: len(frames[place]) // 4 * 4], "<u4").copy()
    if words.size:
        evil = np.concatenate([_WORDS, _WHOLE])
        for _ in range(rng.choice((1, 3))):
            words[rng.randrange(words.size)] = evil[rng.randrange(evil.size)]
    rest = frames[place][words.nbytes :]
    return [*frames[:place], words.tobytes() + rest, *frames[place + 1 :]]
