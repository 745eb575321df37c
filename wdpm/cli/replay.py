"""`wdpm render --replay X,Y,SAMPLE`: one sample, vertex by vertex. Takes all options of a render, writes no image."""

from __future__ import annotations

import argparse

from rich.console import Console

from wdpm import api
from wdpm.cli.options import chosen_settings
from wdpm.cli.scene import viewed_scene_of
from wdpm.cluster.render_settings import RenderSettings
from wdpm.images.files import check_output_path, write_bytes
from wdpm.progress import make_progress
from wdpm.quiet import quiet_warp
from wdpm.rendering.scene_settings import settings_for
from wdpm.replaying.tables import print_replay
from wdpm.scenes.errors import SettingsError


def replay_and_print(args: argparse.Namespace) -> int:
    """Trace a sample and print it; with --report, write it as JSON; returns the exit code."""
    if args.report is not None:
        check_output_path(args.report, (".json",))
    if args.load_cache is not None:
        raise SettingsError(
            "--replay makes the irradiance records of its own view, so a sample that used those of --load-cache would "
            "come out otherwise; leave --load-cache out, or render with --indirect gather to look into a sample"
        )
    chosen = chosen_settings(args)
    RenderSettings(**chosen)  # a value out of range is an error before the scene is read
    quiet_warp()
    progress = make_progress(args.quiet)
    try:
        progress.start("load")
        scene = viewed_scene_of(args)
        settings = settings_for(scene, **chosen)
        x, y, sample = args.replay
        replayed = api.replay(
            scene, x, y, sample, settings, threads=args.threads, device=args.device, progress=progress
        )
    finally:
        progress.finish()
    if args.report is not None:
        write_bytes(replayed.to_json().encode(), args.report)
    print_replay(replayed, Console())  # with --quiet, too: that is all that was asked for
    return 0
