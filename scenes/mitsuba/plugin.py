"""Typed access to what a Mitsuba plugin is given, with an error for everything that nobody asked for."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

from wdpm.scenes.errors import SceneError, did_you_mean
from wdpm.scenes.mitsuba.colours import COLOUR_TAGS, read_colour
from wdpm.scenes.mitsuba.document import Document, Element
from wdpm.scenes.mitsuba.rules import HARMLESS, IMPLIED, RENAMED
from wdpm.scenes.mitsuba.supported import is_known, supported
from wdpm.scenes.mitsuba.values import numbers, read_transform, xyz
from wdpm.scenes.model.textures import RGB
from wdpm.scenes.model.transforms import Matrix

VALUE_TAGS = {"integer", "float", "string", "boolean", "vector", "point", "transform", *COLOUR_TAGS}
OBJECT_TAGS = {"shape", "bsdf", "texture", "emitter", "medium", "phase", "volume"}
OBJECT_TAGS |= {"sensor", "sampler", "film", "rfilter", "integrator"}
FOREIGN_TAGS = {"subsurface", "animation", "random", "luminaire", "camera"}
STRUCTURE_TAGS = {"ref"}


def snake_case(name: str) -> str:
    """Mitsuba 0.6's camelCase as Mitsuba 3's snake_case."""
    return re.sub(r"(?<=[a-z0-9])([A-Z])", r"_\1", name).lower()


class Plugin:
    """One plugin of a scene: its type, its parameters and the plugins nested in it.

    Attributes:
        replaced: whether it stands in for one that is not known, whose parameters mean nothing here.

    Every `take_...` marks what it takes; `finish` complains about the rest. Names are Mitsuba 3's; 0.6's spellings
    are translated.
    """

    def __init__(self, element: Element, document: Document) -> None:
        self.element = element
        self.document = document
        self.category = element.tag
        self.type = element.attribute("type")
        self.id = element.attributes.get("id")
        self.line = element.line
        self.rules = document.rules
        self.replaced = False
        self.known_names: set[str] = set()
        self._values: dict[str, Element] = {}
        self._nested: list[tuple[str, Element]] = []
        for child in element.children:
            self._sort_in(child)
        self._check_supported()

    def _sort_in(self, child: Element) -> None:
        if child.tag in VALUE_TAGS:
            name = snake_case(child.attribute("name"))
            if name in self._values:
                raise child.error(
                    f'{self}: parameter "{name}" is given twice (first in line {self._values[name].line})'
                )
            self._values[name] = child
        elif child.tag == "ref" or child.tag in OBJECT_TAGS:
            nested = self.document.referenced(child) if child.tag == "ref" else child
            if nested.tag not in OBJECT_TAGS or not left_out(nested, self.document):
                self._nested.append((snake_case(child.attributes.get("name", "")), nested))
        elif child.tag in FOREIGN_TAGS:
            what = f"{self}: <{child.tag}> is not supported yet"
            self.rules.refuse(child.error(what), what, "it is left out")
        else:
            raise unknown_tag(child)

    def _check_supported(self) -> None:
        types = supported(self.category)
        if self.type in types:
            return
        what, error = _not_supported(self.element)
        stand_in = _stand_in(self.element, self.document)
        if self.category in HARMLESS:
            self.rules.tell(self.line, f'{what}: it is taken for "{stand_in}", which changes how, not what is computed')
        elif stand_in is None:
            raise error
        else:
            self.rules.refuse(error, what, f'it is taken for "{stand_in}"')
        self.replaced = True
        self._rename_as_stand_in(self.type)
        self.type = stand_in or self.type

    def _rename_as_stand_in(self, plugin_type: str) -> None:
        """Give a stand-in what it can use of the parameters of the plugin for which it stands."""
        self._values = {RENAMED.get(name, name): element for name, element in self._values.items()}
        for name, value in IMPLIED.get(plugin_type, {}).items():
            child = Element("float", {"name": name, "value": value}, self.element.file, self.line)
            self._values.setdefault(name, child)

    def __str__(self) -> str:
        return f'{self.category} "{self.type}"'

    @property
    def name(self) -> str:
        """For messages and reports: the id, or type and line."""
        return self.id or f"{self.type} (line {self.line})"

    def error(self, message: str) -> SceneError:
        return self.element.error(message)

    def has(self, name: str) -> bool:
        """Whether the parameter is given; does not take it."""
        return name in self._values

    def has_nested(self, category: str, name: str, plugin_type: str | None = None) -> bool:
        """Whether a plugin of this category, and of this type, is nested under this name; does not take it."""
        return any(
            given == name and element.tag == category and plugin_type in (None, element.attributes.get("type"))
            for given, element in self._nested
        )

    def nests(self, category: str) -> bool:
        """Whether a plugin of this category is nested under any name; does not take it."""
        return any(element.tag == category for _, element in self._nested)

    def at(self, name: str) -> Element:
        """Where a parameter is given, for messages; the plugin itself where it is not. Ask before taking it."""
        return self._values.get(name, self.element)

    def value_error(self, name: str, message: str) -> SceneError:
        """An error that points at a parameter, or at the plugin where the parameter is not given."""
        return self._values.get(name, self.element).error(f'{self}: "{name}" {message}')

    def _take(self, name: str, tags: Sequence[str]) -> Element | None:
        self.known_names.add(name)
        element = self._values.pop(name, None)
        if element is not None and element.tag not in tags:
            raise element.error(f'{self}: "{name}" must be a <{"> or <".join(tags)}>, not a <{element.tag}>')
        return element

    def take_float(self, name: str, default: float) -> float:
        element = self._take(name, ("float", "integer"))
        if element is None:
            return default
        values = numbers(element.attribute("value"), element)
        if len(values) != 1:
            raise element.error(f'{self}: "{name}" must be one number, got "{element.attribute("value")}"')
        return values[0]

    def take_positive(self, name: str, default: float) -> float:
        element = self._values.get(name, self.element)
        value = self.take_float(name, default)
        if not value > 0:
            raise element.error(f'{self}: "{name}" must be greater than 0, got {value:g}')
        return value

    def take_int(self, name: str, default: int) -> int:
        element = self._take(name, ("integer",))
        if element is None:
            return default
        try:
            return int(element.attribute("value"))
        except ValueError:
            text = element.attribute("value")
            raise element.error(f'{self}: "{name}" must be a whole number, got "{text}"') from None

    def take_bool(self, name: str, default: bool) -> bool:
        element = self._take(name, ("boolean",))
        if element is None:
            return default
        value = element.attribute("value").lower()
        if value not in ("true", "false"):
            raise element.error(f'{self}: "{name}" must be "true" or "false", got "{value}"')
        return value == "true"

    def take_string(self, name: str, default: str | None = None) -> str:
        element = self._take(name, ("string",))
        if element is not None:
            return element.attribute("value")
        if default is None:
            raise self.error(f'{self}: the parameter "{name}" is missing')
        return default

    def take_choice(self, name: str, default: str, options: Sequence[str]) -> str:
        element = self._values.get(name, self.element)
        value = self.take_string(name, default)
        if value not in options:
            raise element.error(f'{self}: "{name}" must be one of {", ".join(options)}, got "{value}"')
        return value

    def take_file(self) -> Path:
        element = self._values.get("filename", self.element)
        return self.document.resolve_file(self.take_string("filename"), element)

    def take_point(self, name: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
        element = self._take(name, ("point", "vector"))
        return default if element is None else xyz(element, 0.0)

    def take_numbers(self, name: str) -> tuple[float, float, float]:
        """Three numbers as they are, or one that stands for three."""
        element = self._take(name, ("vector", "point", "rgb", "float", "integer"))
        if element is None:
            raise self.error(f'{self}: the parameter "{name}" is missing')
        return xyz(element, 0.0)

    def take_transform(self, name: str) -> Matrix | None:
        element = self._take(name, ("transform",))
        return None if element is None else read_transform(element)

    def take_colour(self, name: str, default: RGB, *, emission: bool, most: float = math.inf) -> RGB:
        """A colour as linear sRGB.

        Args:
            emission: whether it is a light's; Mitsuba treats spectra of lights and of surfaces differently.
            most: what spectra outside of sRGB's gamut are cut off at.
        """
        element = self._take(name, COLOUR_TAGS)
        return default if element is None else read_colour(element, self.document, emission=emission, most=most)

    def ignore(self, *names: str) -> list[str]:
        """Takes parameters that change nothing here; returns those that were given."""
        self.known_names.update(names)
        return [name for name in names if self._values.pop(name, None) is not None]

    def ignore_values(self) -> list[str]:
        """Takes all parameters; returns their names."""
        return self.ignore(*self._values)

    def take_nested(self, category: str, name: str | None = None) -> list[Plugin]:
        """The nested plugins of a category, in document order; only those of this parameter name if one is given."""
        if name is not None:
            self.known_names.add(name)
        taken = [pair for pair in self._nested if pair[1].tag == category and name in (None, pair[0])]
        self._nested = [pair for pair in self._nested if pair not in taken]
        return [Plugin(element, self.document) for _, element in taken]

    def take_named(self, category: str) -> list[tuple[str, Plugin]]:
        """The nested plugins of a category with the names that they are nested under, in document order."""
        names = [name for name, element in self._nested if element.tag == category]
        return [*zip(names, self.take_nested(category), strict=True)]

    def count_nested(self, category: str) -> int:
        """How many plugins of a category are nested; does not take them."""
        return sum(element.tag == category for _, element in self._nested)

    def take_one(self, category: str, name: str | None = None) -> Plugin | None:
        """The nested plugin of a category, if there is one; more than one is an error."""
        found = self.take_nested(category, name)
        if len(found) > 1:
            what = f"{self} takes one {category}, got {len(found)}"
            self.rules.refuse(found[1].error(what), what, "the first is taken")
        return found[0] if found else None

    def finish(self) -> None:
        """Raises SceneError if anything is left that nothing took and that may change the picture."""
        for name, element in self._values.items():
            what = f'{self}: unknown parameter "{name}"'
            hint = did_you_mean(name, self.known_names) or f" (known: {', '.join(sorted(self.known_names))})"
            self._leave(element, what, element.error(what + hint))
        for name, element in self._nested:
            label = f' named "{name}"' if name else ""
            hint = did_you_mean(name, self.known_names) if name else ""
            what = f"{self} takes no nested {element.tag}{label}"
            self._leave(element, what, element.error(what + hint))

    def _leave(self, element: Element, what: str, error: SceneError) -> None:
        if self.category in HARMLESS:
            self.rules.tell(element.line, f"{what}: it is ignored")
        else:
            self.rules.refuse(error, what, "it is ignored")


def _not_supported(element: Element) -> tuple[str, SceneError]:
    """What is not supported, in words, and the error that says so."""
    category, plugin_type = element.tag, element.attribute("type")
    types, what = supported(category), f'{category} plugin "{plugin_type}"'
    if is_known(category, plugin_type):
        what = f"{what} is not supported yet"
        return what, element.error(f"{what}; supported: {', '.join(types)}")
    hint = did_you_mean(plugin_type, types)
    return f"unknown {what}", element.error(f"unknown {what}{hint} (supported: {', '.join(types)})")


def _stand_in(element: Element, document: Document) -> str | None:
    """The plugin that may stand in for one that is not known: one that differs in capitals alone, or the rules'."""
    small = element.attribute("type").lower()
    if small in supported(element.tag):
        return small
    return document.rules.stand_in(element.tag, element.attribute("type"))


def left_out(element: Element, document: Document) -> bool:
    """Whether a plugin is left out of the scene, as a lenient reader does with one that nothing can stand in for."""
    category, plugin_type = element.tag, element.attribute("type")
    rules = document.rules
    if not rules.lenient or plugin_type in supported(category) or _stand_in(element, document) is not None:
        return False
    what, error = _not_supported(element)
    rules.refuse(error, what, "it is left out")
    return True


def unknown_tag(element: Element) -> SceneError:
    """The error for an element that Mitsuba does not know."""
    known = VALUE_TAGS | OBJECT_TAGS | STRUCTURE_TAGS | FOREIGN_TAGS | {"default", "include", "alias", "path"}
    return element.error(f"unknown element <{element.tag}>{did_you_mean(element.tag, known)}")
