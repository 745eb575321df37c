"""The reference, in Markdown, made of the code: parsers of options, settings, layers, plugins, public names."""

from __future__ import annotations

import argparse
import inspect
import re
from collections.abc import Iterable
from dataclasses import fields
from enum import Enum
from functools import cache
from typing import Any

import wdpm
from wdpm.cli.main import make_parser
from wdpm.cli.options import SETTING_OPTIONS
from wdpm.cluster.render_settings import CHANGE_NO_BIT, RenderSettings
from wdpm.images.channels import LAYER_CHANNELS
from wdpm.scenes.mitsuba import read  # noqa: F401 - readers say what they read as they are imported
from wdpm.scenes.mitsuba.rules import HARMLESS, NEAREST, STAND_IN
from wdpm.scenes.mitsuba.supported import KNOWN, supported

LAYERS_IN_WORDS = {
    "beauty": "the image: `direct` + `indirect` + `caustic` + `volume`, radiance in W/(m² sr) where lengths are metres",
    "direct": "lights that are seen, and light straight from them, also in mirrors and through glass",
    "indirect": "light off diffuse surfaces",
    "caustic": "light that glossy surfaces alone have led onto diffuse ones; where the render has a caustic map",
    "volume": "what media scatter towards the camera; in scenes with media",
    "depth": "distance from the camera to what is seen, in the scene's units",
    "normal": "shading normal in world space, towards the camera",
    "albedo": "share of light that the diffuse part reflects",
    "cell": "number of the part of the scene that shaded the pixel's first sample; depends on the cluster",
    "noise": "standard error of `beauty`, from 2 passes on",
    "bias": "estimate of the blur in `beauty`, with sign, from 4 passes on",
    "samples": "that each pixel has had, in renders with `--adaptive`",
}


def options(command: str, benchmark: str = "") -> str:
    """All options of a command, under their headings. Groups that `wdpm render` has as well are only named."""
    parser = _commands()[command]
    if benchmark:
        parser = _choices(parser)[benchmark]
    said = [] if command == "render" else [_key(group) for group in _commands()["render"]._action_groups]
    pieces = [_text(parser.description or ""), f"```text\n{_usage(parser)}\n```"]
    alike = []
    for group in parser._action_groups:
        actions = [each for each in group._group_actions if not isinstance(each, argparse._HelpAction)]
        if not actions or any(isinstance(each, argparse._SubParsersAction) for each in actions):
            continue
        if _key(group) in said and actions[0].option_strings:
            alike.append(f"*{group.title}*")
            continue
        pieces += [f"**{_escaped((group.title or '').capitalize())}**", _option_table(actions)]
    if alike:
        pieces.append(f"And those of [`wdpm render`](#wdpm-render) for {_listed(alike)}.")
    if parser.epilog:
        pieces.append(f"```text\n{parser.epilog}\n```")
    return "\n\n".join(pieces)


def commands() -> list[str]:
    """The names of all commands."""
    return list(_commands())


def benchmarks() -> str:
    """All benchmarks, each with its options."""
    each = [f"### wdpm bench {name}\n\n{options('bench', name)}" for name in _choices(_commands()["bench"])]
    return "\n\n".join(each)


def settings() -> str:
    """The fields of RenderSettings, with their options, defaults and meaning."""
    meaning = _attributes(RenderSettings)
    named = {each.field: each for each in SETTING_OPTIONS}
    rows = []
    for field in fields(RenderSettings):
        option = named[field.name]
        default = option.default or _in_words(field.default)
        rows.append((f"`{field.name}`", f"`--{field.name.replace('_', '-')}`", default, meaning[field.name]))
    free = _listed([f"`{name}`" for name in CHANGE_NO_BIT])
    return _table(("in Python", "option", "default", "meaning"), rows) + f"\n\n{free} change no bit of the image."


def layers() -> str:
    """The layers of an image."""
    shapes = {"RGB": "[height, width, 3]", "XYZ": "[height, width, 3]"}
    rows = [
        (f"`{name}`", f"`{channels}`", f"`{shapes.get(channels, '[height, width]')}`", LAYERS_IN_WORDS[name])
        for name, channels in LAYER_CHANNELS.items()
    ]
    return _table(("layer", "channels in EXR", "shape in Python", "what"), rows)


def plugins() -> str:
    """Mitsuba's plugins: those that are read, and what becomes of the others."""
    pieces = []
    for category, known in KNOWN.items():
        rows = [(f"`{name}`", "read") for name in supported(category)]
        rows += [(f"`{name}`", _fate(category, name)) for name in known if name not in supported(category)]
        pieces.append(f"## {category}\n\n{_table(('plugin', ''), rows)}")
    return "\n\n".join(pieces)


def python() -> str:
    """Directives that show the docstrings of all public names."""
    pieces = []
    for name in wdpm.__all__:
        kind = getattr(wdpm, name)
        if inspect.ismodule(kind):
            continue
        directive = "autofunction"
        if inspect.isclass(kind):
            directive = "autoexception" if issubclass(kind, Exception) else "autoclass"
        members = "" if directive == "autofunction" or issubclass(kind, RenderSettings) else ":members:\n"
        pieces.append(f"```{{{directive}}} wdpm.{name}\n{members}```")
    return "\n\n".join(pieces)


@cache
def _commands() -> dict[str, argparse.ArgumentParser]:
    return _choices(make_parser())


def _choices(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """The parsers of subcommands by name."""
    (found,) = (each for each in parser._actions if isinstance(each, argparse._SubParsersAction))
    choices: dict[str, argparse.ArgumentParser] = found.choices
    return choices


def _key(group: argparse._ArgumentGroup) -> tuple[Any, ...]:
    """Two groups of the same key say the same."""
    return (group.title, *((*each.option_strings, each.help) for each in group._group_actions))


def _usage(parser: argparse.ArgumentParser) -> str:
    """In short: the positional arguments, and that there are options."""
    if parser.usage:
        return parser.usage
    words = [each.metavar or each.dest for each in parser._actions if not each.option_strings]
    return " ".join([parser.prog, *map(str, words), "[options]"])


def _option_table(actions: Iterable[argparse.Action]) -> str:
    rows = []
    for action in actions:
        metavar = (
            "" if action.nargs == 0 else f" {action.metavar or '|'.join(action.choices or ()) or action.dest.upper()}"
        )
        names = ", ".join(f"`{name}{metavar}`" for name in action.option_strings) or f"`{metavar.strip()}`"
        rows.append((names, _text(action.help or "")))
    return _table(("option", "what"), rows)


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def _text(text: str) -> str:
    """Help as one paragraph of Markdown."""
    return _escaped(" ".join(text.split()).replace("%%", "%"))


def _escaped(text: str) -> str:
    """Text in which Markdown sees nothing but code in backticks."""
    pieces = text.split("`")
    return "`".join(re.sub(r"([*_<>\[\]$#])", r"\\\1", each) if i % 2 == 0 else each for i, each in enumerate(pieces))


def _attributes(kind: type) -> dict[str, str]:
    """What the docstring of a data class says of its fields."""
    _, _, listed = inspect.getdoc(kind).partition("Attributes:\n")
    found: dict[str, str] = {}
    for line in listed.splitlines():
        if match := re.match(r"    (\w+): (.*)", line):
            name = match[1]
            found[name] = match[2]
        elif line.strip():
            found[name] += " " + line.strip()
    return {name: _escaped(text) for name, text in found.items()}


def _fate(category: str, plugin: str) -> str:
    if category in HARMLESS:
        return f"a warning; taken for `{HARMLESS[category]}`"
    stand_in = NEAREST.get(category, {}).get(plugin) or STAND_IN.get(category)
    return f"an error; with `--lenient` taken for `{stand_in}`" if stand_in else "an error; with `--lenient` left out"


def _in_words(default: object) -> str:
    if isinstance(default, Enum):
        return str(default.value)
    return "none" if default in (None, ()) else "off" if default is False else f"{default:,}"


def _listed(items: list[str]) -> str:
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"
