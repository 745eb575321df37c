"""A scene description as a tree of elements that know their file and line.

Handles what lies between XML and plugins: `default`, `$name` and definitions from the command line, `include`, `path`,
`alias`. Document type declarations are refused, so no entity can expand or reach outside.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from wdpm.scenes.beside import folders_beside
from wdpm.scenes.errors import SceneError, did_you_mean
from wdpm.scenes.git_lfs import check_not_a_pointer
from wdpm.scenes.mitsuba.rules import Rules
from wdpm.scenes.scene_root import check_within

MAX_INCLUDE_DEPTH = 15  # Mitsuba's own limit; a file that includes itself ends here

MAX_NESTING = 32  # elements within elements, in one file; real scenes have some five

PARAMETER_NAME = re.compile(r"\$(?:\{(\w+)\}|(\w+))")


@dataclass(eq=False)
class Element:
    """One XML element.

    Attributes:
        tag: as written.
        attributes: values after substitution of `$name`.
        file, line: where its start tag is, the line counted from 1.
    """

    tag: str
    attributes: dict[str, str]
    file: Path
    line: int
    children: list[Element] = field(default_factory=list)

    def error(self, message: str) -> SceneError:
        """An error that points here."""
        return SceneError(message, self.file, self.line)

    def attribute(self, name: str) -> str:
        """The value of an attribute that must be there."""
        try:
            return self.attributes[name]
        except KeyError:
            raise self.error(f'<{self.tag}> lacks the attribute "{name}"') from None


@dataclass(eq=False)
class Document:
    """A scene file with everything it includes.

    Attributes:
        root: the <scene> element; includes are replaced by what they include.
        search_paths: folders in which file names are looked up, the scene's own first.
        ids: elements by their id, aliases included.
        rules: what becomes of what nobody understands.
    """

    root: Element
    search_paths: list[Path]
    ids: dict[str, Element]
    rules: Rules = field(default_factory=Rules)

    def resolve_file(self, name: str, at: Element) -> Path:
        """The file that a scene names, looked up beside the naming file, then in the search paths."""
        for folder in self._folders(at):
            if (folder / name).is_file():
                check_within(folder / name, at.file, at.line)
                check_not_a_pointer(folder / name, at.file, at.line)
                return folder / name
        raise at.error(f'file "{name}" not found (looked in {", ".join(map(str, self._folders(at)))})')

    def _folders(self, at: Element) -> list[Path]:
        return list(dict.fromkeys([*folders_beside(at.file), *self.search_paths]))

    def referenced(self, ref: Element) -> Element:
        """The element that a <ref id="..."/> names."""
        name = ref.attribute("id")
        if name not in self.ids:
            raise ref.error(f'reference to "{name}", which no element has as its id{did_you_mean(name, self.ids)}')
        return self.ids[name]


def read_document(file: Path, defines: Mapping[str, str]) -> Document:
    """Reads a scene file and all that it includes.

    Args:
        defines: values of `$name` parameters; they win over <default>.

    Raises:
        SceneError: broken XML, an undefined parameter, a definition that nothing uses, a missing include, equal ids.
    """
    reader = _Reader(defines)
    root = reader.read_tree(file)
    if root.tag != "scene":
        raise root.error(f"expected <scene> as the outermost element, found <{root.tag}>")
    document = Document(root, [file.parent], {})
    root.children = list(reader.expand(root.children, document, depth=0))
    reader.check_all_used(file)
    for alias in reader.aliases:
        _add_id(document.ids, alias.attribute("as"), document.referenced(alias), alias)
    _check_no_circles(document)
    return document


def _check_no_circles(document: Document) -> None:
    """Raise SceneError for an element that holds a reference to itself, however far inside."""
    done: set[Element] = set()
    for start in document.ids.values():
        way = [start]  # from the outside in
        left = [list(_inside(start, document))]
        while way:
            if not left[-1]:
                done.add(way.pop())
                left.pop()
                continue
            at, inner = left[-1].pop()
            if inner in way:
                name = inner.attributes.get("id", "")
                what = "an instance of itself" if inner.tag == "shape" else "itself"
                raise at.error(f'the reference leads back to <{inner.tag}> "{name}": it would hold {what}')
            if inner not in done:
                way.append(inner)
                left.append(list(_inside(inner, document)))


def _inside(element: Element, document: Document) -> Iterator[tuple[Element, Element]]:
    """What an element holds, and where it says so; references to what is not there are left to whoever follows them."""
    for child in element.children:
        inner = document.ids.get(child.attributes.get("id", "")) if child.tag == "ref" else child
        if inner is not None:
            yield child, inner


def _add_id(ids: dict[str, Element], name: str, element: Element, at: Element) -> None:
    if name in ids:
        raise at.error(f'the id "{name}" is already taken in line {ids[name].line} of {ids[name].file.name}')
    ids[name] = element


class _Reader:
    """Parses files and substitutes parameters, in the order of the document as Mitsuba does."""

    def __init__(self, defines: Mapping[str, str]) -> None:
        self.defines = dict(defines)
        self.parameters = dict(defines)
        self.used: set[str] = set()
        self.aliases: list[Element] = []

    def read_tree(self, file: Path) -> Element:
        try:
            data = file.read_bytes()
        except OSError as error:
            raise SceneError(f"cannot be read: {error.strerror}", file) from error
        return _TreeBuilder(file).build(data)

    def expand(self, elements: list[Element], document: Document, depth: int) -> Iterator[Element]:
        for element in elements:
            self._substitute(element)
            if element.tag == "default":
                self.parameters.setdefault(element.attribute("name"), element.attribute("value"))
            elif element.tag == "include":
                yield from self._include(element, document, depth)
            elif element.tag == "alias":
                self.aliases.append(self._renamed_alias(element))
            elif element.tag == "path":
                document.search_paths.insert(0, self._folder(element, document))
            else:
                if "id" in element.attributes and element.tag != "ref":
                    _add_id(document.ids, element.attributes["id"], element, element)
                element.children = list(self.expand(element.children, document, depth))
                yield element

    def _renamed_alias(self, element: Element) -> Element:
        element.attribute("id")
        element.attribute("as")
        return element

    def _folder(self, element: Element, document: Document) -> Path:
        """Beside the file that names it or, as for other files, in one of the folders known so far."""
        value = element.attributes.get("value") or element.attribute("name")
        folders = [folder / value for folder in (*folders_beside(element.file), *document.search_paths)]
        found = next((folder for folder in folders if folder.is_dir()), None)
        if found is None:
            raise element.error(f'<path>: folder "{folders[0]}" not found')
        return found

    def _include(self, element: Element, document: Document, depth: int) -> Iterator[Element]:
        if depth >= MAX_INCLUDE_DEPTH:
            raise element.error(f"includes lie more than {MAX_INCLUDE_DEPTH} deep; does a file include itself?")
        included = self.read_tree(document.resolve_file(element.attribute("filename"), element))
        inside = included.children if included.tag == "scene" else [included]
        yield from self.expand(inside, document, depth + 1)

    def _substitute(self, element: Element) -> None:
        for key, value in element.attributes.items():
            if "$" in value:
                element.attributes[key] = PARAMETER_NAME.sub(lambda found: self._value(found, element), value)

    def _value(self, found: re.Match[str], element: Element) -> str:
        name = found[1] or found[2]
        if name not in self.parameters:
            hint = did_you_mean(name, self.parameters)
            raise element.error(
                f"parameter ${name} has no value: give -D {name}=... or a <default> above this line{hint}"
            )
        self.used.add(name)
        return self.parameters[name]

    def check_all_used(self, file: Path) -> None:
        for name in self.defines:
            if name not in self.used:
                hint = did_you_mean(name, self.parameters.keys() - {name})
                raise SceneError(f"-D {name}=...: nothing in the scene uses ${name}{hint}", file)


class _TreeBuilder:
    """Builds elements from expat's events, because expat knows the lines."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.stack: list[Element] = []
        self.root: Element | None = None
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self.parser.StartDoctypeDeclHandler = self._doctype

    def build(self, data: bytes) -> Element:
        try:
            self.parser.Parse(data, True)
        except expat.ExpatError as error:
            reason = expat.ErrorString(error.code)
            raise SceneError(f"broken XML: {reason} (column {error.offset + 1})", self.file, error.lineno) from error
        except (LookupError, ValueError) as error:
            # expat asks Python for the codec of an encoding it does not know itself
            raise SceneError(f"broken XML: {error}", self.file, self.parser.CurrentLineNumber) from error
        if self.root is None:
            raise SceneError("broken XML: no element in it", self.file)
        return self.root

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, self.file, self.parser.CurrentLineNumber)
        if len(self.stack) == MAX_NESTING:
            raise element.error(f"<{tag}> lies within {MAX_NESTING} other elements; no deeper nesting is read")
        if self.stack:
            self.stack[-1].children.append(element)
        else:
            self.root = element
        self.stack.append(element)

    def _end(self, _tag: str) -> None:
        self.stack.pop()

    def _text(self, text: str) -> None:
        if text.strip():
            raise SceneError(
                f'text "{text.strip()[:40]}" between elements; values belong into attributes',
                self.file,
                self.parser.CurrentLineNumber,
            )

    def _doctype(self, *_details: object) -> None:
        line = self.parser.CurrentLineNumber
        raise SceneError("document type declarations (<!DOCTYPE ...>) are not accepted; remove it", self.file, line)
