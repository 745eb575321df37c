"""`wdpm accuracy --predict`: loads the scene, flies the pilot, prints the table."""

from __future__ import annotations

import argparse

from rich.console import Console

from wdpm.accuracy.predict import predict
from wdpm.cli.options import chosen_settings
from wdpm.cli.scene import scene_of
from wdpm.goal.render import CHOSEN_HERE
from wdpm.goal.workplace import Workplace
from wdpm.local_backend import backend_here
from wdpm.progress import make_progress
from wdpm.quiet import quiet_warp
from wdpm.scenes.errors import SettingsError

OF_SWEEPS = ("sweep", "seeds", "budget", "reference", "reference_time", "clock", "trim", "output", "slaves")
"""Options that say how to sweep."""


def predict_and_print(args: argparse.Namespace) -> int:
    """What errors would cost; returns the exit code.

    Raises:
        SettingsError: an option that says how to sweep, or a setting that would be picked.
        SceneError: see its message.
    """
    chosen = chosen_settings(args)
    for name in sorted(CHOSEN_HERE & set(chosen)):
        raise SettingsError(f"--predict tells what --until-error would do, which chooses {name}; leave it out")
    typed = [name for name in OF_SWEEPS if getattr(args, name) not in (None, [])]
    if typed:
        options = ", ".join(f"--{name.replace('_', '-')}" for name in typed)
        raise SettingsError(f"--predict makes no sweep, and has no use for these: leave {options} out")
    quiet_warp()
    progress = make_progress(args.quiet)
    try:
        progress.start("load")
        scene = scene_of(args)
        progress.start("pilot")
        with backend_here(threads=args.threads, device=args.device) as backend:
            found = predict(scene, Workplace(backend, progress), **chosen)
    finally:
        progress.finish()
    found.print(Console())
    return 0
