"""The scene that a command line names, loaded as its options say."""

from __future__ import annotations

import argparse
from typing import Any

from wdpm.scenes.load import load
from wdpm.scenes.model.scene import Scene
from wdpm.scenes.model.viewpoint import Viewpoint, cropped, seen_from


def scene_of(args: argparse.Namespace, **view: Any) -> Scene:
    """The scene of SCENE, -D, --size and --lenient.

    Args:
        view: `camera`, `frame` and `time` of `load`.

    Raises:
        SceneError: with file and line where known.
    """
    return load(args.scene, defines=dict(args.definitions), size=args.size, lenient=args.lenient, **view)


def viewed_scene_of(args: argparse.Namespace) -> Scene:
    """The same, seen as --camera, --frame and --crop say, for commands with `options.add_view_options`.

    Raises:
        SceneError: as `scene_of`, or there is no such view.
    """
    named = args.camera if isinstance(args.camera, str) else None
    scene = scene_of(args, camera=named, frame=args.frame, time=args.time)
    if isinstance(args.camera, Viewpoint):
        scene = seen_from(scene, args.camera)
    return scene if args.crop is None else cropped(scene, args.crop)
