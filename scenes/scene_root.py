"""The folder that a scene's files must lie in, if whoever loads it has given one.

A scene names other files: meshes, pictures, includes. It may name any, by paths that climb out of its folder too, and
they are read with the rights of whoever loads it. Who loads scenes of others gives a folder; what lies elsewhere is an
error then, and links are followed before they are judged.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from wdpm.scenes.errors import SceneError

_ROOT: ContextVar[Path | None] = ContextVar("scene root", default=None)


@contextmanager
def files_within(root: Path | None) -> Iterator[None]:
    """While open, `check_within` refuses files outside of a folder, which None leaves as it is.

    Raises:
        SceneError: this is no folder.
    """
    if root is None:
        yield
        return
    if not root.is_dir():
        raise SceneError("the scene root is no folder", root)
    token = _ROOT.set(root.resolve())
    try:
        yield
    finally:
        _ROOT.reset(token)


def check_within(file: Path, named_in: Path | None = None, line: int | None = None) -> None:
    """Raise SceneError if a file lies outside of the scene root.

    Args:
        named_in, line: the file that names it, for the message.
    """
    root = _ROOT.get()
    if root is not None and not file.resolve().is_relative_to(root):
        raise SceneError(f'"{file}" lies outside of the scene root {root}', named_in, line)
