"""Warp's own messages, kept off the command line: which modules it loads, and that there is no GPU."""

from __future__ import annotations

import os
import sys
import tempfile
from typing import IO

from wdpm.scenes.errors import MachineError, SettingsError

_NO_GPU = "Could not find or load the NVIDIA CUDA driver"


def quiet_warp() -> None:
    """Start Warp without its banner. Only for commands: a program that uses wdpm decides for itself.

    Warp has no module option for this, so its global setting is used. That there is no CUDA driver is written by
    compiled code straight to standard error: it is caught there, and everything else is passed on.

    Raises:
        SettingsError: there is no folder for temporary files, or none for compiled kernels.
        MachineError: its libraries cannot be loaded: there are too few addresses for them (`ulimit -v`), say.
    """
    import warp as wp

    from wdpm.kernels.cached import cache_errors_in_words

    wp.config.log_level = wp.LOG_WARNING
    sys.stderr.flush()
    with _temporary_file() as caught, cache_errors_in_words():
        kept = os.dup(2)
        os.dup2(caught.fileno(), 2)
        try:
            wp.init()
        except RuntimeError as error:
            raise MachineError(f"Warp cannot be loaded: {error.__cause__ or error}") from None
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            caught.seek(0)
            said = caught.read().decode(errors="replace")
            print("\n".join(line for line in said.splitlines() if _NO_GPU not in line), end="", file=sys.stderr)


def _temporary_file() -> IO[bytes]:
    try:
        return tempfile.TemporaryFile()
    except OSError as error:
        reason = error.strerror or str(error)
        raise SettingsError(
            f"no temporary file can be written ({reason}); set TMPDIR to a folder that you can write to"
        ) from None
