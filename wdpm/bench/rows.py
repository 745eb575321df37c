"""What a benchmark has measured so far, in a file that grows row by row, so that one that was stopped can go on.

JSON lines: first what all rows have in common, then one line for each measurement, written as soon as it is there:

    {"machine": {...}}
    {"of": {"scene": "hall.xml", "slaves": 2}, "figures": {...}}

A line that a killed process left half written is dropped, and measured again.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from wdpm.cluster.versions import versions
from wdpm.images.files import check_output_path
from wdpm.report.grid import machine
from wdpm.scenes.errors import SettingsError

Figures = dict[str, Any]
"""A measurement, as JSON has it."""


class Rows:
    """Measurements by what they are of.

    Args:
        file: that keeps them; None to keep them nowhere.
        resume: go on from what the file has.

    Raises:
        SettingsError: the file is there already, or holds rows of another machine or version.
        ImageError: it cannot be written.
    """

    def __init__(self, file: Path | None = None, *, resume: bool = False) -> None:
        self._file = file
        self._known: dict[str, Figures] = {}
        if file is None:
            if resume:
                raise SettingsError("--resume goes on from the rows of a file: give --rows FILE.jsonl, too")
            return
        check_output_path(file, (".jsonl",))
        here = {"machine": machine(), "code": versions()["wdpm code"]}
        if resume and file.is_file():
            self._read(file, here)
        elif file.exists():
            raise SettingsError(f"{file}: is there already; give --resume to go on from it, or another name")
        else:
            self._append(here)

    def measured(self, of: Mapping[str, Any], measure: Callable[[], Figures]) -> Figures:
        """A measurement that the file has, or a new one, which it then has as well.

        Args:
            of: what it is of, as JSON has it.
        """
        key = _key(of)
        if key not in self._known:
            self._known[key] = measure()
            self._append({"of": dict(of), "figures": self._known[key]})
        return self._known[key]

    def has(self, of: Mapping[str, Any]) -> bool:
        """Whether it is measured already."""
        return _key(of) in self._known

    def _append(self, row: Mapping[str, Any]) -> None:
        if self._file is not None:
            with self._file.open("a") as stream:
                stream.write(json.dumps(row, allow_nan=False) + "\n")

    def _read(self, file: Path, here: Mapping[str, Any]) -> None:
        """Take what is whole, and cut off what is not."""
        text = file.read_text()
        whole = text[: text.rfind("\n") + 1]
        try:
            head, *rows = [json.loads(line) for line in whole.splitlines()]
            self._known = {_key(row["of"]): dict(row["figures"]) for row in rows}
        except (ValueError, KeyError, TypeError) as error:
            raise SettingsError(f"{file}: no rows of a benchmark ({error}); give another name") from None
        if head != json.loads(json.dumps(here)):
            raise SettingsError(f"{file}: its rows are of another machine, or of other versions; give another name")
        if whole != text:
            file.write_text(whole)


def _key(of: Mapping[str, Any]) -> str:
    return json.dumps(dict(of), sort_keys=True)
