"""Warp's own messages, kept off the command line: which modules it loads, and that there is no GPU."""

from __future__ import annotations

import os
import sys
import tempfile

_NO_GPU = "Could not find or load the NVIDIA CUDA driver"


def quiet_warp() -> None:
    """Start Warp without its banner. Only for commands: a program that uses wdpm decides for itself.

    Warp has no module option for this, so its global setting is used. That there is no CUDA driver is written by
    compiled code straight to standard error: it is caught there, and everything else is passed on.
    """
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING
    sys.stderr.flush()
    with tempfile.TemporaryFile() as caught:
        kept = os.dup(2)
        os.dup2(caught.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            caught.seek(0)
            said = caught.read().decode(errors="replace")
            print("\n".join(line for line in said.splitlines() if _NO_GPU not in line), end="", file=sys.stderr)
