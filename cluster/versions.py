"""What the bits of an image depend on besides scene and settings: the code, and the libraries that compute."""

from __future__ import annotations

import functools
import hashlib
import platform
from importlib import metadata
from pathlib import Path

CODE = ("scenes", "kernels", "cluster")
"""The packages whose code decides about bits; of scenes, slaves run flat/ and the data classes that it reads."""


@functools.cache
def versions() -> dict[str, str]:
    """By name; all processes of a cluster must have the same."""
    return {
        "wdpm code": _digest_of_code(),
        "warp-lang": metadata.version("warp-lang"),
        "numpy": metadata.version("numpy"),
        "instruction set": platform.machine(),
    }


def _digest_of_code() -> str:
    package = Path(__file__).resolve().parent.parent
    sha = hashlib.sha256()
    for name in CODE:
        # In a checkout the folders lie where this one lies; installed, both are in the package.
        for path in sorted((package / name).rglob("*.py")):
            sha.update(f"{path.relative_to(package).as_posix()}\n".encode())
            sha.update(path.read_bytes())
    return sha.hexdigest()[:12]
