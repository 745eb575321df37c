"""Machines that SSH reaches, as a command line names them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from wdpm.scenes.errors import SettingsError

# A word that begins with a dash would be an option of ssh, and one with spaces or quotes something else again.
_HOST = re.compile(
    r"(?P<user>\w[\w.-]*@)?(?:(?P<name>\w[\w.-]*)|\[(?P<number>[0-9A-Fa-f]*:[0-9A-Fa-f:.]+)\])(?::(?P<slaves>[1-9]\d{0,2}))?",
    re.ASCII,
)


@dataclass(frozen=True)
class Host:
    """A machine.

    Attributes:
        name: as ssh takes it, with a user perhaps.
        slaves: that are to run there.
    """

    name: str
    slaves: int = 1


def read_hosts(words: Iterable[str]) -> tuple[Host, ...]:
    """Read NAME, USER@NAME, NAME:SLAVES or [IPv6]:SLAVES; SettingsError for anything else, or none."""
    if isinstance(words, str):  # its letters are no names
        raise SettingsError(f"hosts is {words!r}; expected several, like [{words!r}]")
    if not isinstance(words, Iterable):
        raise SettingsError(f"hosts is {words!r}; expected names of machines, like ['anna', 'bert:2']")
    hosts = []
    for word in words:
        match = _HOST.fullmatch(word) if isinstance(word, str) else None
        if match is None:
            raise SettingsError(f"'{word}' is no host: expected NAME, USER@NAME or NAME:SLAVES, like anna:2")
        name = (match["user"] or "") + (match["name"] or match["number"])
        hosts.append(Host(name, int(match["slaves"] or 1)))
    if not hosts:
        raise SettingsError("no host is named")
    return tuple(hosts)
