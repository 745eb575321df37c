"""What a person may check where nobody is found at an endpoint: no firewall keeps sockets apart that are files."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Final

LOCAL: Final = "ipc://"
"""How endpoints begin whose sockets are files in a folder."""


def check_reach(endpoint: str, otherwise: str) -> str:
    """What to do about it.

    Args:
        otherwise: what to do where the socket is no file.
    """
    if not endpoint.startswith(LOCAL):
        return otherwise
    return f"see that nothing clears {folder_of(endpoint)}, where the sockets are, or set TMPDIR to another folder"


def folder_of(endpoint: str) -> PurePosixPath:
    """The folder of an endpoint's socket, which is a file."""
    return PurePosixPath(endpoint.removeprefix(LOCAL)).parent
