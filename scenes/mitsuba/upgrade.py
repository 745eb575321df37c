"""Brings the elements of old Mitsuba files up to version 0.6, whose names the readers know beside Mitsuba 3's.

Of all files, what is written in two ways is written in one: a <spectrum> with a type is a <texture>.

What has changed from version to version: Mitsuba 0.6's own upgrades, data/schema/upgrade_*.xsl.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

from wdpm.scenes.mitsuba.document import Document, Element

_TAGS: Final = {"luminaire": "emitter", "camera": "sensor"}
_FILES: Final = {
    "exrfilm": "hdrfilm",
    "pngfilm": "ldrfilm",
    "errctrl": "adaptive",
    "ldrtexture": "bitmap",
    "exrtexture": "bitmap",
}
_EVERYWHERE: Final = {"focusDepth": "focusDistance", "intensityScale": "scale", "densityMultiplier": "scale"}
_RADIANCE: Final = {"area": "radiance", "constant": "radiance", "directional": "irradiance"}

_LAST_WITH_BUMP, _LAST_WITH_LUMINAIRES = (0, 5), (0, 4)


def upgrade(document: Document) -> None:
    """Rename in place what a file older than version 0.5 calls otherwise, and what has two names in all."""
    for element in _all(document):
        if element.tag == "spectrum" and "type" in element.attributes:
            element.tag = "texture"
    version = version_of(document)
    if version is None:
        return
    if version < _LAST_WITH_LUMINAIRES:
        for element in _all(document):
            _to_0_4(element)
    if version < _LAST_WITH_BUMP:
        for element in _all(document):
            if element.tag == "bsdf" and element.attributes.get("type") == "bump":
                element.attributes["type"] = "bumpmap"


def version_of(document: Document) -> tuple[int, int] | None:
    """Major and minor version that a file says it is for; None where it does not, as numbers."""
    found = re.match(r"(\d+)\.(\d+)", document.root.attributes.get("version", ""))
    return None if found is None else (int(found[1]), int(found[2]))


def _all(document: Document) -> Iterator[Element]:
    """Every element, each once, children after their parents."""
    waiting = [document.root]
    while waiting:
        element = waiting.pop()
        yield element
        waiting.extend(element.children)


def _to_0_4(element: Element) -> None:
    element.tag = _TAGS.get(element.tag, element.tag)
    kind = element.attributes.get("type", "")
    element.attributes |= {"type": _FILES[kind]} if kind in _FILES else {}
    if element.tag == "emitter" and kind in _RADIANCE:
        _rename(element, {"intensity": _RADIANCE[kind]})
    _rename(element, _EVERYWHERE)
    if element.tag == "film":
        element.children = [child for child in element.children if child.attributes.get("name") != "alpha"]
    if element.tag == "sensor":
        _upgrade_sensor(element, kind)


def _upgrade_sensor(sensor: Element, kind: str) -> None:
    """Images were mirrored, and a field of view was that of the smaller side unless the file said otherwise."""
    for child in sensor.children:
        if child.tag == "transform":
            child.children.insert(0, Element("scale", {"x": "-1"}, child.file, child.line))
    smaller = [child for child in sensor.children if child.attributes.get("name") == "mapSmallerSide"]
    sensor.children = [child for child in sensor.children if child not in smaller]
    if kind == "perspective":
        larger = any(child.attributes.get("value") == "false" for child in smaller)
        attributes = {"name": "fovAxis", "value": "larger" if larger else "smaller"}
        sensor.children.append(Element("string", attributes, sensor.file, sensor.line))


def _rename(element: Element, names: dict[str, str]) -> None:
    for child in element.children:
        name = child.attributes.get("name", "")
        if name in names:
            child.attributes["name"] = names[name]
