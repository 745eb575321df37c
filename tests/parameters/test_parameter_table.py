"""Every parameter that Mitsuba 3 documents, of every plugin that is read: what becomes of it, and of wrong values.

The table in docs/mitsuba-parameters.md is made here: run this file to write it anew.
"""

from __future__ import annotations

import re
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from mitsuba_parameters import PARAMETERS
from parameter_scenes import Fate, fate, parameter_xml, read, write_files

from wdpm.scenes import SceneError
from wdpm.scenes.mitsuba import sky

PAGE = Path(__file__).resolve().parents[2] / "docs" / "mitsuba-parameters.md"

HEAD = """\
# Mitsuba's parameters

Every parameter that the documentation of Mitsuba 3 has (August 2026) of the plugins that are read ([which those
are](scenes.md#plugins)), and what becomes of it in a file: made by
[tests/parameters/test_parameter_table.py](../tests/parameters/test_parameter_table.py), which reads a scene with each.
What means nothing here says how Mitsuba computes or writes, and is taken without a word. Types stand beside a name
where they fare differently. An error is a warning with `--lenient`. Names of 0.6, and what more than a table can say,
are in [scenes.md](scenes.md#mitsuba-xml).

"""

WRONG = {
    "float": ("abc", "", "nan", "1e400", "-1e30", "0", "1e30", "1 2"),
    "int": ("x", "", "1.5", "-7", "0", "99999999999999999999"),
    "bool": ("maybe", "", "1"),
    "spectrum": ("x", "", "1 2", "-1 0 0", "nan", "inf 0 0", "#ffffff", "400:1"),
    "string": ("", "no such thing", "/", "\u00e4"),
    "point": ("x,0,0", "nan,0,0", "0,0,0"),
    "vector": ("x,0,0", "inf,0,0", "0,0,0"),
    "transform": ("x", "nan"),
}
"""Values of a type that are wrong, or nearly."""

OTHER_TAGS = ("string", "float", "spectrum", "transform", "texture", "volume", "bool")
"""Of parameters of another type than a plugin takes."""

CASES = [(category, plugin) for category, plugins in PARAMETERS.items() for plugin in plugins]


def row(folder: Path, monkeypatch: pytest.MonkeyPatch, category: str, plugin: str) -> str:
    """A plugin's row of the table."""
    found: dict[Fate, list[str]] = {each: [] for each in Fate}
    for name, kinds in PARAMETERS[category][plugin].items():
        fates = {kind: fate(folder, monkeypatch, category, plugin, name, kind) for kind in kinds}
        for each in Fate:
            of_these = [kind for kind, became in fates.items() if became is each]
            if of_these:
                types = f" ({', '.join(of_these)})" if len(set(fates.values())) > 1 else ""
                found[each].append(f"`{name}`{types}")
    cells = [", ".join(names) or "-" for names in found.values()]
    return f"| {category} `{plugin}` | " + " | ".join(cells) + " |"


def small_skies(monkeypatch: pytest.MonkeyPatch) -> None:
    """Skies of a few pixels, which take no time to work out; what a file says of them is read as ever."""
    monkeypatch.setattr(sky, "sky_map", lambda _: np.ones((4, 8, 3), np.float32))


def page(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The whole page."""
    small_skies(monkeypatch)
    write_files(folder)
    lines = ["| plugin | " + " | ".join(each.value for each in Fate) + " |", "| --- | --- | --- | --- | --- |"]
    lines += [row(folder, monkeypatch, category, plugin) for category, plugin in CASES]
    return HEAD + "\n".join(lines) + "\n"


def test_the_page_says_what_becomes_of_each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert PAGE.read_text() == page(tmp_path, monkeypatch), f"run {Path(__file__).name} to write the page anew"


@pytest.mark.parametrize("category", PARAMETERS)
def test_wrong_values_are_one_line_with_file_and_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, category: str
) -> None:
    small_skies(monkeypatch)
    write_files(tmp_path)
    refused = tried = 0
    for plugin, parameters in PARAMETERS[category].items():
        for name, kinds in parameters.items():
            xmls = [parameter_xml(name, kind, value, plugin) for kind in kinds for value in WRONG.get(kind, ())]
            xmls += [parameter_xml(name, kind, plugin=plugin) for kind in OTHER_TAGS if kind not in kinds]
            xmls.append(2 * parameter_xml(name, kinds[0], plugin=plugin))
            for xml in xmls:
                tried += 1
                try:
                    read(tmp_path, category, plugin, xml, name)
                except SceneError as error:
                    refused += 1
                    message = str(error)
                    assert re.match(rf"{re.escape(str(tmp_path))}/(scene\.xml:[2-4]|a\.\w+|sky\.exr)\b", message), xml
                    assert "\n" not in message, xml
    assert refused >= tried // 4


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made, pytest.MonkeyPatch.context() as patch:
        PAGE.write_text(page(Path(made), patch))
    sys.stdout.write(f"wrote {PAGE}\n")
