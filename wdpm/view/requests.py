"""What a page may ask for, checked."""

from __future__ import annotations

import json
from collections.abc import Container, Mapping
from dataclasses import dataclass
from typing import Any

STOP, ENOUGH = "stop", "enough"
"""Actions: end the render, as Ctrl-C does; end it after the pass in progress, and write the image."""

ACTIONS = (STOP, ENOUGH)


class BadRequestError(ValueError):
    """A page's message makes no sense; the text says why."""


@dataclass(frozen=True)
class ViewRequest:
    """One message of a page.

    Attributes:
        action: one of ACTIONS; None where it is about pixels.
        wants: (picture, layer) to send from now on.
    """

    action: str | None = None
    wants: tuple[tuple[str, str], ...] = ()


def read_request(text: str, pictures: Container[str]) -> ViewRequest:
    """A page's message.

    Args:
        pictures: those that there are.

    Raises:
        BadRequestError: it makes no sense.
    """
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):  # the latter by brackets in brackets in brackets
        raise BadRequestError("a message is no JSON") from None
    if not isinstance(message, Mapping):
        raise BadRequestError("a message is no object")
    kind = message.get("kind")
    if kind in ACTIONS:
        return ViewRequest(action=str(kind))
    if kind != "want":
        raise BadRequestError(f"unknown kind of message {kind!r}: expected want, {', '.join(ACTIONS)}")
    return ViewRequest(wants=_wants(message.get("layers"), pictures))


def _wants(layers: Any, pictures: Container[str]) -> tuple[tuple[str, str], ...]:
    pairs = isinstance(layers, list) and all(
        isinstance(pair, list) and len(pair) == 2 and all(isinstance(word, str) for word in pair) for pair in layers
    )
    if not pairs:
        raise BadRequestError("want.layers is no list of [picture, layer]")
    unknown = [source for source, _ in layers if source not in pictures]
    if unknown:
        raise BadRequestError(f"there is no picture {unknown[0]!r}")
    return tuple((source, layer) for source, layer in layers)
