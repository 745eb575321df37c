"""What the bits of an image depend on besides scene and settings: the code, and the libraries that compute."""

from __future__ import annotations

import functools
import hashlib
import platform
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
        paths = sorted((root / name).rglob("*.py"))
        if not paths:
            raise ClusterError(f"{root / name}: expected the code of wdpm as files; install it unpacked")
        for path in paths:
            sha.update(f"{path.relative_to(root).as_posix()}\n".encode())
            sha.update(path.read_bytes())
    return sha.hexdigest()[:12]
