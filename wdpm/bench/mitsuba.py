"""`wdpm bench mitsuba`: wdpm against Mitsuba 3's path tracer on the same scene, in time and in error, by turns.

Both are warm: kernels compiled, the scene loaded, one image rendered before. wdpm's time is that of the whole
`wdpm.render`: pilot, tree, photons, map and image; Mitsuba's that of `mitsuba.render` until all pixels are there.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from wdpm.bench import mitsuba_peer
from wdpm.bench.outputs import settings_to_dict
from wdpm.cluster.render_settings import RenderSettings
from wdpm.images.image import Image
from wdpm.images.image import load as load_image
from wdpm.progress import Progress
from wdpm.rendering.backend import Backend
from wdpm.rendering.passes import render_in_passes
from wdpm.report.grid import Grid
from wdpm.report.tables import format_seconds
from wdpm.scenes.errors import ImageError, SceneError, WdpmError
from wdpm.scenes.load import load
from wdpm.scenes.model.scene import Scene

WARM_SEED = 2**20
"""Seed of the images that only warm up; the rounds count from 0."""

EDGE_SPP = 64
EDGE_STEP = 1e-3
"""An emitter's edge is where emitted light, seen with 64 samples a pixel, changes by more than a thousandth."""


@dataclass(frozen=True)
class Setup:
    """What is rendered by both.

    Attributes:
        scene: Mitsuba XML file.
        width, height: of the image.
        settings: of wdpm; each round has its own seed.
        mitsuba_spp: samples a pixel of Mitsuba.
        rounds: images of each.
        threads: of Mitsuba: as many as wdpm has.
    """

    scene: Path
    width: int = 512
    height: int = 512
    settings: RenderSettings = field(default_factory=RenderSettings)
    mitsuba_spp: int = 64
    rounds: int = 5
    threads: int = 1


@dataclass(frozen=True)
class Round:
    """Seconds of one image each, one right after the other."""

    wdpm_s: float
    mitsuba_s: float

    @property
    def ratio(self) -> float:
        """How many times as long as Mitsuba wdpm takes."""
        return self.wdpm_s / self.mitsuba_s


@dataclass(frozen=True)
class Cost:
    """Of one image.

    Attributes:
        wall_s: until the last pixel [s].
        cpu_s: of all threads together [s], which hardly depends on what else the machine does.
    """

    wall_s: float
    cpu_s: float


@dataclass(frozen=True)
class Errors:
    """Against the reference, root mean square over all pixels, channels and rounds.

    Attributes:
        rmse: over all pixels.
        rmse_no_edges: over pixels with no emitter's edge in their 3x3 neighbourhood. Where a bright lamp meets a dark
            wall, a pixel's error is how well its samples tell the two apart, and hides that of all light transport.
    """

    rmse: float
    rmse_no_edges: float


@dataclass(frozen=True)
class MitsubaFigures:
    """What was measured.

    Attributes:
        edge_pixels: share of the pixels that `rmse_no_edges` leaves out.
    """

    setup: Setup
    mitsuba_version: str
    rounds: tuple[Round, ...]
    wdpm: Errors | None
    mitsuba: Errors | None
    edge_pixels: float | None

    @property
    def ratio(self) -> float:
        """Median of the rounds' ratios."""
        return statistics.median(each.ratio for each in self.rounds)

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        setup = asdict(self.setup) | {"scene": str(self.setup.scene)}
        setup["settings"] = settings_to_dict(self.setup.settings)
        rounds = [asdict(each) | {"ratio": each.ratio} for each in self.rounds]
        return asdict(self) | {"setup": setup, "rounds": rounds, "ratio": self.ratio}

    def grid(self) -> Grid:
        """The table."""
        setup, settings = self.setup, self.setup.settings
        photons = f"wdpm, {settings.spp} samples, {settings.photons:,} photons, k {settings.k}"
        path = f"Mitsuba {self.mitsuba_version} path, {setup.mitsuba_spp} samples"
        ours = [each.wdpm_s for each in self.rounds]
        theirs = [each.mitsuba_s for each in self.rounds]
        rows = [
            (photons, format_seconds(statistics.median(ours)), *_errors_in_words(self.wdpm)),
            (path, format_seconds(statistics.median(theirs)), *_errors_in_words(self.mitsuba)),
            ("wdpm / Mitsuba", f"{self.ratio:.2f}", *self._error_ratios()),
        ]
        pairs = " ".join(f"{each.ratio:.2f}" for each in self.rounds)
        notes = [f"Medians of {len(self.rounds)} rounds by turns; ratio of the times round by round: {pairs}"]
        if self.edge_pixels is None:
            notes.append("No errors without --reference FILE, an image of this size with far more samples.")
        else:
            notes.append(f"Edges of lamps: {self.edge_pixels:.2%} of the pixels, left out in the last column.")
        title = f"{setup.scene}, {setup.width}x{setup.height}, {setup.threads} threads"
        return Grid(title, ("renderer", "time", "RMSE", "RMSE without edges of lamps"), tuple(rows), tuple(notes))

    def _error_ratios(self) -> tuple[str, str]:
        if self.wdpm is None or self.mitsuba is None:
            return "-", "-"
        pairs = (
            (self.wdpm.rmse, self.mitsuba.rmse),
            (self.wdpm.rmse_no_edges, self.mitsuba.rmse_no_edges),
        )
        words = [f"{ours / theirs:.2f}" if theirs else "-" for ours, theirs in pairs]
        return words[0], words[1]


def measure(setup: Setup, reference_file: Path | None, backend: Backend, progress: Progress) -> MitsubaFigures:
    """Render by turns and compare.

    Args:
        setup: its threads are those of the backend, whatever it says.
        reference_file: image of the same size that errors are measured against; None measures times only.

    Raises:
        SceneError: not a Mitsuba scene, or it cannot be loaded.
        ImageError: the reference cannot be read, or has another size.
        WdpmError: Mitsuba is not installed, or fails.
    """
    if setup.scene.suffix.lower() != ".xml":
        raise SceneError(f"'{setup.scene}' cannot be rendered by both: expected a Mitsuba scene, a file SCENE.xml")
    if find_spec("mitsuba") is None:
        raise WdpmError("bench mitsuba: Mitsuba 3 is not installed: pip install 'wdpm[peers]'")
    progress.start("load")
    scene = load(setup.scene, size=(setup.width, setup.height))
    # Both trace paths of the same length: what the file asks for, or no limit.
    settings = replace(setup.settings, max_depth=scene.max_depth)
    setup = replace(setup, settings=settings, threads=backend.threads)
    reference = None if reference_file is None else _read_reference(reference_file, setup)
    progress.start("warm up")
    with MitsubaProcess(setup) as mitsuba:
        mitsuba.render(setup.mitsuba_spp, WARM_SEED)
        timed_render(scene, backend, setup.settings, WARM_SEED)
        progress.start("rounds", setup.rounds)
        rounds, ours, theirs = [], [], []
        for seed in range(setup.rounds):
            image, seconds = timed_render(scene, backend, setup.settings, seed)
            pixels, mitsuba_seconds = mitsuba.render(setup.mitsuba_spp, seed)
            rounds.append(Round(seconds, mitsuba_seconds))
            ours.append(image.pixels)
            theirs.append(pixels)
            progress.advance()
        version = mitsuba.version
    if reference is None:
        return MitsubaFigures(setup, version, tuple(rounds), None, None, None)
    edges = emitter_edges(scene, backend, setup.settings)
    return MitsubaFigures(
        setup,
        version,
        tuple(rounds),
        errors_of(ours, reference, edges),
        errors_of(theirs, reference, edges),
        float(edges.mean()),
    )


def emitter_edges(scene: Scene, backend: Backend, settings: RenderSettings) -> NDArray[np.bool_]:
    """Pixels whose 3x3 neighbourhood contains an emitter's edge, shape [height, width].

    The scene's emission alone is rendered, filtered like any image: an edge is where it is not constant.
    """
    settings = replace(settings, photons=0, max_depth=1, spp=EDGE_SPP)
    emission = render_in_passes(scene, backend, settings).pixels
    padded = np.pad(emission, ((1, 1), (1, 1), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3), axis=(0, 1))
    low, high = windows.min(axis=(-2, -1)), windows.max(axis=(-2, -1))
    edges: NDArray[np.bool_] = (high - low > EDGE_STEP * high).any(axis=2)
    return edges


def errors_of(images: list[NDArray[np.float32]], reference: NDArray[np.float32], edges: NDArray[np.bool_]) -> Errors:
    """Errors of several images of one renderer.

    Args:
        images, reference: shape [height, width, 3].
        edges: pixels to leave out of `rmse_no_edges`, shape [height, width].
    """
    squared = np.mean([(image.astype(np.float64) - reference) ** 2 for image in images], axis=0)
    kept = squared[~edges]
    if not kept.size:
        raise ImageError("every pixel lies at an emitter's edge: choose a larger --size")
    return Errors(rmse=float(np.sqrt(squared.mean())), rmse_no_edges=float(np.sqrt(kept.mean())))


class MitsubaProcess:
    """Mitsuba with the scene loaded, in a process of its own.

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
        command = [sys.executable, "-P", str(Path(mitsuba_peer.__file__))]
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
            "max_depth": -1 if setup.settings.max_depth is None else setup.settings.max_depth,
            "threads": setup.threads,
        }
        self.version = str(self._ask({"load": order})["version"])

    def render(self, spp: int, seed: int) -> tuple[NDArray[np.float32], float]:
        """Pixels, shape [height, width, 3], and seconds."""
        pixels, cost = self.render_with_cost(spp, seed)
        return pixels, cost.wall_s

    def render_with_cost(self, spp: int, seed: int) -> tuple[NDArray[np.float32], Cost]:
        """Pixels, shape [height, width, 3], and what they took."""
        output = Path(self._folder.name) / "image.npy"
        answer = self._ask({"render": {"spp": spp, "seed": seed, "output": str(output)}})
        pixels: NDArray[np.float32] = np.load(output, allow_pickle=False)
        expected = (self._setup.height, self._setup.width, 3)
        if pixels.shape != expected:
            raise WdpmError(f"bench mitsuba: Mitsuba made an image of shape {pixels.shape}; expected {expected}")
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
            raise WdpmError(f"bench mitsuba: Mitsuba's process ended: {self._last_words()}")
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            hint = " (DRJIT_LIBLLVM_PATH names LLVM's library)" if "llvm" in answer["error"].lower() else ""
            raise WdpmError(f"bench mitsuba: Mitsuba says: {answer['error']}{hint}")
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


def timed_render(scene: Scene, backend: Backend, settings: RenderSettings, seed: int) -> tuple[Image, float]:
    """wdpm's image, and the seconds of the whole call."""
    began = time.perf_counter()
    image = render_in_passes(scene, backend, replace(settings, seed=seed))
    return image, time.perf_counter() - began


def _read_reference(file: Path, setup: Setup) -> NDArray[np.float32]:
    reference = load_image(file)
    if reference.shape != (setup.height, setup.width):
        height, width = reference.shape
        raise ImageError(
            f"{file}: is {width}x{height}, and the render {setup.width}x{setup.height}: use --size {width}x{height}"
        )
    return reference.pixels


def _errors_in_words(errors: Errors | None) -> tuple[str, str]:
    return ("-", "-") if errors is None else (f"{errors.rmse:.4f}", f"{errors.rmse_no_edges:.4f}")
