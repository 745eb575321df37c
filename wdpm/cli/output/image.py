"""What a command that renders makes, whoever computes it: an image, the image that a goal asks for, or a sequence."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from wdpm.cli import options
from wdpm.cli.goal import add_until_options, asks_for_a_goal, render_to_goal
from wdpm.cli.journals import add_journal_options, journals
from wdpm.cli.live import add_view_options, shown
from wdpm.cli.output.frames import add_frame_options, asks_for_frames, render_frames

if TYPE_CHECKING:  # it needs what computes, which a command that is only asked for help does not import
    from wdpm.rendering.backend import Backend

MakeBackend = Callable[[], "Backend"]
"""Makes what renders, and whoever calls it closes that."""


def add_image_options(parser: argparse.ArgumentParser) -> None:
    """What is rendered, how, and where it goes."""
    options.add_scene_options(parser)
    options.add_view_options(parser)
    options.add_output_options(parser)
    options.add_setting_options(parser)
    add_journal_options(parser)
    add_until_options(parser)
    options.add_cache_options(parser)
    add_view_options(parser)
    add_frame_options(parser)


def chosen_way(args: argparse.Namespace) -> Callable[[argparse.Namespace, MakeBackend], int]:
    """What makes the image or the images that are asked for: renders and writes, and gives the exit code.

    Raises:
        SettingsError: options contradict each other; to be found before slaves are started.
    """
    if asks_for_frames(args):
        return render_frames
    if asks_for_a_goal(args):
        return render_to_goal
    return _render_image


def _render_image(args: argparse.Namespace, make_backend: MakeBackend) -> int:
    """Render and write one image."""
    from wdpm.cli.result import first_output, render_and_write
    from wdpm.rendering.cache_file import CacheFiles
    from wdpm.rendering.passes import render_in_passes

    cache = CacheFiles(args.save_cache, args.load_cache)
    with shown(args) as view, journals(args, first_output(args)) as journal:

        def render(source: Any, settings: Any, progress: Any) -> Any:
            with make_backend() as backend:
                backend.display = view
                return render_in_passes(source, backend, settings, progress=progress, cache=cache, **journal)

        return render_and_write(args, render, view)
