"""Mitsuba 3 with a scene loaded, in a process of its own: its images, and what they took."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from wdpm.bench.peers import mitsuba_program
from wdpm.scenes.errors import WdpmError


@dataclass(frozen=True)
class Setup:
    """What Mitsuba renders.

    Attributes:
        scene: Mitsuba XML file.
        width, height: of the image [pixels].
        max_depth: longest light path in edges; None for no limit.
        threads: to render with.
    """

    scene: Path
    width: int
    height: int
    max_depth: int | None = None
    threads: int = 1


@dataclass(frozen=True)
class Cost:
    """Of one image.

    Attributes:
        wall_s: until the last pixel [s].
        cpu_s: of all threads together [s], which hardly depends on what else the machine does.
    """

    wall_s: float
    cpu_s: float


class MitsubaProcess:
    """Mitsuba with the scene loaded; a context, at whose end the process ends.

    Raises:
        WdpmError: Mitsuba cannot be started, or cannot load or render the scene.
    """

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self.version = ""

    def __enter__(self) -> Self:
        self._folder = tempfile.TemporaryDirectory(prefix="wdpm-bench-")
        self._log = tempfile.TemporaryFile()
        # -P: the folder of the program holds wdpm's modules, which must not hide others by their names.
        command = [sys.executable, "-P", str(Path(mitsuba_program.__file__))]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log, text=True
        )
        try:
            self._load()
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def _load(self) -> None:
        setup = self._setup
        order = {
            "file": str(setup.scene),
            "width": setup.width,
            "height": setup.height,
            "max_depth": -1 if setup.max_depth is None else setup.max_depth,
            "threads": setup.threads,
        }
        self.version = str(self._ask({"load": order})["version"])

    def render(self, spp: int, seed: int) -> tuple[NDArray[np.float32], Cost]:
        """Pixels, shape [height, width, 3], and what they took."""
        output = Path(self._folder.name) / "image.npy"
        answer = self._ask({"render": {"spp": spp, "seed": seed, "output": str(output)}})
        pixels: NDArray[np.float32] = np.load(output, allow_pickle=False)
        expected = (self._setup.height, self._setup.width, 3)
        if pixels.shape != expected:
            raise WdpmError(f"bench peers: Mitsuba made an image of shape {pixels.shape}; expected {expected}")
        return pixels, Cost(float(answer["seconds"]), float(answer["cpu_seconds"]))

    def _ask(self, order: dict[str, Any]) -> dict[str, Any]:
        if self._process.stdin is None or self._process.stdout is None:
            raise AssertionError("the process was started with pipes")
        try:
            self._process.stdin.write(json.dumps(order) + "\n")
            self._process.stdin.flush()
            line = self._process.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            raise WdpmError(f"bench peers: Mitsuba's process ended: {self._last_words()}")
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            hint = " (DRJIT_LIBLLVM_PATH names LLVM's library)" if "llvm" in answer["error"].lower() else ""
            raise WdpmError(f"bench peers: Mitsuba says: {answer['error']}{hint}")
        return answer

    def _last_words(self) -> str:
        code = self._process.wait()
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else f"exit code {code}"

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            self._process.kill()
        # Closes its standard input, at which it ends.
        self._process.communicate()
        self._log.close()
        self._folder.cleanup()
