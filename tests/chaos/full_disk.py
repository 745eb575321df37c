"""A render whose disk is full: where its journal is, or where its image is to go. Needs root, to mount a tiny disk."""

from __future__ import annotations

import contextlib
import random
import re
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from commands import command, drawn, options_of
from slaves import ENVIRONMENT
from trials import Trial, digest_of, expected

from wdpm.images.image import load

ROOM_FOR_NOTHING = 16 << 10
ROOM = 32 << 20
"""Of a disk that is full only after a while [bytes]: a render looks for room before it begins."""

LONGEST_S = 300.0
KEPT = re.compile(r"the image is kept in (\S+\.exr)")


@contextmanager
def tiny_disk(size: int) -> Iterator[Path]:
    """A folder on a disk of so many bytes."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "none", folder], check=True)
        try:
            yield Path(folder)
        finally:
            subprocess.run(["umount", folder], check=True)


def trial(number: int, seed: int) -> Trial:
    """A render by two slaves; every other one has room for the journal, but none for the image when that is done."""
    what = drawn(random.Random(f"{seed} disk {number}"), number // 2)
    wanted = expected(*what.picture)
    began = time.monotonic()
    words = command("render", what.scene, *options_of(what), "--slaves", "2")
    error = _without_journal(words, wanted) if number % 2 == 0 else _without_image(words, wanted)
    happened = "no room for the image" if number % 2 else "no room for the journal"
    return Trial("disk", number, what, (happened,), time.monotonic() - began, error=error)


def _without_journal(words: list[str], wanted: str) -> str:
    """The render goes on and says so; returns what is wrong."""
    with tiny_disk(ROOM_FOR_NOTHING) as small, tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "image.exr"
        words = [*words, "-o", str(output), "--journal", str(small)]
        ended = subprocess.run(words, env=ENVIRONMENT, capture_output=True, text=True, timeout=LONGEST_S, check=False)
        if ended.returncode or "the render goes on without" not in ended.stderr:
            return f"exit code {ended.returncode}: {ended.stderr[-500:]}"
        return _compare(output, wanted)


def _without_image(words: list[str], wanted: str) -> str:
    """The image is kept elsewhere, and the last line says where; returns what is wrong."""
    with tiny_disk(ROOM) as small, tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        words = [*words, "-o", str(small / "image.exr"), "--journal", folder, "--log", str(log)]
        process = subprocess.Popen(words, env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        try:
            while process.poll() is None and not (log.exists() and '"phase"' in log.read_text()):
                time.sleep(0.05)
            with contextlib.suppress(OSError):
                (small / "filler").write_bytes(bytes(ROOM + 1))
            said = process.communicate(timeout=LONGEST_S)[1]
        finally:
            process.kill()
            process.wait()
        kept = KEPT.search(said)
        if process.returncode != 2 or "Traceback" in said or kept is None:
            return f"exit code {process.returncode}: {said[-500:]}"
        error = _compare(Path(kept[1]), wanted)
        Path(kept[1]).unlink()
        Path(kept[1]).parent.rmdir()
        return error


def _compare(image: Path, wanted: str) -> str:
    digest = digest_of(load(image))
    return "" if digest == wanted else f"bits differ: {digest}, of one process {wanted}"
