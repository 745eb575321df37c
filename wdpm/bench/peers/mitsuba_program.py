"""The process that `wdpm bench peers` talks to: Mitsuba 3, alone with its threads, its compiler and its warnings.

A program to be run, which imports nothing of wdpm. It reads one order a line from standard input and writes one
answer a line to standard output, all as JSON: {"load": ...} once, then {"render": ...} any number of times.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import time
from typing import Any

import numpy as np

VARIANT = "llvm_ad_rgb"

MOST_SAMPLES = 1 << 24
"""Of an image at once: Mitsuba keeps the random state of each, so that 1,024 samples of 256x256 pixels would take
gigabytes. More are rendered in equal parts, and their mean is what comes out."""

SEEDS_OF_PARTS = 1 << 21
"""Between the seeds of two parts: more than a benchmark gives to images."""


def parts_of(spp: int, pixels: int) -> int:
    """The least number of equal parts in which an image is small enough, or one sample each."""
    fewest = min(spp, -(-spp * pixels // MOST_SAMPLES))
    return next(parts for parts in range(fewest, spp + 1) if spp % parts == 0)


class Renderer:
    """A scene in Mitsuba.

    Args:
        file: Mitsuba XML.
        width, height: of the image, whatever the file says.
        max_depth: longest light path in edges; -1 for no limit.
        threads: to render with.
    """

    def __init__(self, file: str, width: int, height: int, max_depth: int, threads: int) -> None:
        self._mitsuba: Any = importlib.import_module("mitsuba")
        self._mitsuba.set_variant(VARIANT)
        importlib.import_module("drjit").set_thread_count(threads)
        self._scene = self._mitsuba.load_file(file)
        parameters = self._mitsuba.traverse(self._scene)
        for name in parameters.keys():  # noqa: SIM118 - not a dict: iterating gives pairs
            if name.endswith(("film.size", "film.crop_size")):
                parameters[name] = self._mitsuba.ScalarVector2u(width, height)
        parameters.update()
        self._pixels = width * height
        self._integrator = self._mitsuba.load_dict({"type": "path", "max_depth": max_depth})

    def render(self, spp: int, seed: int, output: str) -> dict[str, float]:
        """Render into an NPY file, float32, shape [height, width, 3]; returns the time until the last pixel [s]."""
        began, cpu_began = time.perf_counter(), time.process_time()
        parts = parts_of(spp, self._pixels)
        pixels = np.mean([self._part(spp // parts, seed + SEEDS_OF_PARTS * part) for part in range(parts)], axis=0)
        taken = {"seconds": time.perf_counter() - began, "cpu_seconds": time.process_time() - cpu_began}
        np.save(output, pixels[..., :3].astype(np.float32))
        return taken

    def _part(self, spp: int, seed: int) -> Any:
        image = self._mitsuba.render(self._scene, integrator=self._integrator, spp=spp, seed=seed)
        return np.array(image)  # waits for the render, which runs on other threads


def main() -> None:
    """Obey orders until standard input closes."""
    # Whatever Mitsuba prints must not come between the answers.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    renderer: Renderer | None = None
    for line in sys.stdin:
        order = json.loads(line)
        try:
            if "load" in order:
                renderer = Renderer(**order["load"])
                answer: dict[str, Any] = {"version": sys.modules["mitsuba"].__version__}
            elif renderer is not None:
                answer = renderer.render(**order["render"])
            else:
                answer = {"error": "nothing was loaded"}
        except Exception as error:  # whatever it is, the person who waits at the other end should read it
            answer = {"error": " ".join(str(error).split()) or type(error).__name__}
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
