"""Programs of the system that answer a question: one line says why one did not."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence

from wdpm.scenes.errors import SettingsError


def answer_of(command: Sequence[str], seconds: float) -> str:
    """What a program prints.

    Args:
        command: its words.
        seconds: that it may take.

    Raises:
        SettingsError: there is none, it takes longer, or it fails; with the last line that it said of that.
    """
    words = " ".join(command)
    try:
        ended = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace", timeout=seconds
        )
    except FileNotFoundError:
        raise SettingsError(f"there is no program {command[0]}") from None
    except OSError as error:
        raise SettingsError(f"{words}: {(error.strerror or str(error)).lower()}") from None
    except subprocess.TimeoutExpired:
        raise SettingsError(f"{words}: has not ended within {seconds:g} s") from None
    if ended.returncode:
        said = ended.stderr.strip().splitlines() or [f"it ended with exit code {ended.returncode}"]
        raise SettingsError(f"{words}: {said[-1]}")
    return ended.stdout
