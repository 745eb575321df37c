"""An ssh that runs commands on this machine, as a login shell there would, and remembers how it was called."""

from __future__ import annotations

import sys
from pathlib import Path

SSH = """#!/bin/bash
printf '%s\\n' "$@" CALL >> {folder}/calls
[ "$1" = -G ] && [ "$3" = odd ] && {{ echo "Bad owner or permissions on /home/me/.ssh/config" >&2; exit 255; }}
[ "$1" = -G ] && {{ printf 'user me\\nhostname 127.0.0.1\\nport 22\\n'; exit; }}
while [ "$1" != -- ]; do shift; done
case $2 in
    mute) exec sleep 600;;
    touch) echo "Confirm user presence for key ED25519-SK" >&2; exec sleep 600;;
    deaf) echo "ssh: connect to host deaf port 22: Connection refused" >&2; exit 255;;
esac
cd /
exec sh -c "$3"
"""

WDPM = """#!/bin/bash
exec {python} -m wdpm "$@"
"""


def make_ssh(folder: Path) -> Path:
    """Write the program; returns its folder, for PATH."""
    _write(folder / "ssh", SSH.format(folder=folder))
    return folder


def make_wdpm(path: Path) -> str:
    """Write a program that is `wdpm` with this interpreter; returns its path."""
    _write(path, WDPM.format(python=sys.executable))
    return str(path)


def calls(folder: Path) -> list[list[str]]:
    """Words of each call."""
    return [call.splitlines() for call in (folder / "calls").read_text().split("CALL\n") if call]


def _write(path: Path, text: str) -> None:
    path.write_text(text)
    path.chmod(0o755)
