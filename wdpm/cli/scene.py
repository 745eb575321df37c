"""The scene that a command line names, loaded as its options say."""

from __future__ import annotations

import argparse

from wdpm.scenes.load import load
from wdpm.scenes.model.scene import Scene


def scene_of(args: argparse.Namespace) -> Scene:
    """The scene of SCENE, -D, --size and --lenient.

    Raises:
        SceneError: with file and line where known.
    """
    return load(args.scene, defines=dict(args.definitions), size=args.size, lenient=args.lenient)
