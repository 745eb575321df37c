"""What the bits of an image depend on besides scene and settings: the code, and the libraries that compute."""

from __future__ import annotations

import functools
import hashlib
import os
import platform
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from wdpm.scenes.errors import ClusterError

CODE = ("scenes", "kernels", "cluster")
"""The packages whose code decides about bits. All of scenes counts, though slaves run no more of it than flat/ and the
data classes. Files of data, such as the sky's, do not: the master alone reads them."""


@functools.cache
def versions() -> dict[str, str]:
    """By name; all processes of a cluster must have the same."""
    return {
        "wdpm code": digest_of_code(Path(__file__).resolve().parents[1]),
        "warp-lang": metadata.version("warp-lang"),
        "numpy": metadata.version("numpy"),
        "instruction set": platform.machine(),
    }


def digest_of_code(root: Path) -> str:
    """Of every Python file in CODE: its name and its bytes.

    Args:
        root: the folder that those packages lie in. In a checkout that is the repository's, installed it is wdpm/.

    Raises:
        ClusterError: a package has no files there: what runs came from elsewhere, and nothing could be compared.
    """
    sha = hashlib.sha256()
    for name in CODE:
        files = sorted(_python_files(root / name, name))
        if not files:
            raise ClusterError(f"{root / name}: expected the code of wdpm as files; install it unpacked")
        for named, path in files:
            sha.update(f"{named}\n".encode())
            with open(path, "rb", buffering=0) as file:
                sha.update(file.readall())
    return sha.hexdigest()[:12]


def _python_files(folder: Path | str, name: str) -> Iterator[tuple[str, str]]:
    """All in a folder that is called so from the root, and below it: the name of each, with slashes, and its path."""
    if not os.path.isdir(folder):
        return
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir():
                yield from _python_files(entry.path, f"{name}/{entry.name}")
            elif entry.name.endswith(".py"):
                yield f"{name}/{entry.name}", entry.path
