"""`wdpm bench device`: the bits of another device against the CPU's: kernel by kernel, whole images, a mixed cluster.

Without a GPU the CPU may stand in for the device: then this shows that the comparison works, and nothing of GPUs.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import warp as wp

from wdpm.bench import effects_scenes
from wdpm.bench.gpu.allowance import Allowance
from wdpm.bench.gpu.compilation import all_kernels
from wdpm.bench.gpu.launches import KernelRecord, LaunchComparison
from wdpm.bench.gpu.mixed_cluster import MixedCluster
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings, Routing
from wdpm.images.image import Image
from wdpm.progress import Progress
from wdpm.rendering.backend import Backend
from wdpm.rendering.in_process import InProcess, render_in_process
from wdpm.rendering.passes import render_in_passes
from wdpm.report.grid import Grid
from wdpm.report.tables import format_seconds
from wdpm.scenes.load import load
from wdpm.scenes.model.scene import FilterKind, PixelFilter, Scene

BUILT_IN = ("cornell-box", "atrium:20k")
SMALL = (24, 18)
"""Pixels of the renders whose launches are repeated: each launch is copied to the device and back."""

FEW = RenderSettings(spp=2, photons=4000, caustic_photons=2000, volume_photons=2000, max_depth=6)

FILTERS = {
    effects_scenes.DIFFUSE: PixelFilter(FilterKind.MITCHELL, 2.0),
    effects_scenes.EVERYTHING: PixelFilter(FilterKind.LANCZOS, 4.0),
}
"""Of scenes whose launches are repeated: samples that count in several pixels, and signed ones, whose kernels nothing
else launches."""

WAYS: tuple[dict[str, Any], ...] = (
    {"indirect": Indirect.MAP, "routing": Routing.MERGE},
    {"indirect": Indirect.GATHER},
    {"indirect": Indirect.CACHE},
    {"integrator": Integrator.PATH},
)
"""Between them they launch every kernel."""


@dataclass(frozen=True)
class SceneBits:
    """One scene rendered by the CPU, by the device, and by a cluster of a slave on either.

    Attributes:
        seconds: wall-clock of the second render, in this order; kernels are compiled in the first.
        device_equal, mixed_equal: whether all bits of all layers are those of the CPU.
    """

    name: str
    seconds: tuple[float, float, float]
    device_equal: bool
    mixed_equal: bool


@dataclass(frozen=True)
class DeviceFigures:
    """What the device did.

    Attributes:
        device: its name, and in words.
        kernels: what was seen of each kernel that was launched.
        unseen: kernels that were not, those that build trees on the CPU apart.
        left_out: scenes, and kernels of scenes, for which no time was left.
    """

    device: tuple[str, str]
    kernels: dict[str, KernelRecord]
    unseen: tuple[str, ...]
    scenes: tuple[SceneBits, ...]
    left_out: tuple[str, ...]

    @property
    def equal(self) -> bool:
        """Whether all bits were the CPU's."""
        of_scenes = all(scene.device_equal and scene.mixed_equal for scene in self.scenes)
        return of_scenes and not any(record.differing for record in self.kernels.values())

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        return {"equal": self.equal, **asdict(self)}

    def grids(self) -> list[Grid]:
        """A table of kernels, and one of scenes."""
        name, words = self.device
        stands_in = ("The CPU stood in for a GPU: this says that the comparison works, and nothing of GPUs.",)
        notes = (*(stands_in if name == "cpu" else ()), f"Not compared: {', '.join(self.unseen) or 'none'}.")
        kernels = Grid(
            f"Kernels on {words} against the CPU, each launch on the same input",
            ("kernel", "launches", "items", "bits", "first difference"),
            tuple(_kernel_row(kernel, record) for kernel, record in sorted(self.kernels.items())),
            notes,
        )
        late = (f"No time was left for: {', '.join(self.left_out)}.",) if self.left_out else ()
        scenes = Grid(
            f"Images by {words} and by a mixed cluster against the CPU",
            ("scene", "CPU", "device", "CPU / device", "bits", "slaves on both", "bits"),
            tuple(_scene_row(scene) for scene in self.scenes),
            ("Times are of a second render, whose kernels are compiled.", *late),
        )
        return [kernels, scenes]


def _kernel_row(kernel: str, record: KernelRecord) -> tuple[str, ...]:
    bits = f"{record.differing:,} DIFFER" if record.differing else "equal"
    return kernel, f"{record.launches:,}", f"{record.items:,}", bits, str(record.first or "-")


def _scene_row(scene: SceneBits) -> tuple[str, ...]:
    cpu, device, mixed = scene.seconds
    words = ["equal" if equal else "DIFFER" for equal in (scene.device_equal, scene.mixed_equal)]
    times = [format_seconds(seconds) for seconds in (cpu, device, mixed)]
    return scene.name, times[0], times[1], f"{cpu / device:.2f}", words[0], times[2], words[1]


def scenes_to_render(names: Sequence[str], size: tuple[int, int]) -> Iterator[tuple[str, Callable[[], Scene]]]:
    """Scenes by name, made when they are asked for.

    Args:
        names: files or built-in scenes; none for the built-in ones, those of `wdpm bench effects`, and all in the
            folder that WDPM_SCENES names.
    """
    if not names:
        for name in (effects_scenes.DIFFUSE, effects_scenes.EVERYTHING):
            yield name, partial(effects_scenes.scene_of, name, size)
    for name in names or (*BUILT_IN, *_shared_scenes()):
        yield name, partial(_sized, name, size)


def _shared_scenes() -> list[str]:
    folder = os.environ.get("WDPM_SCENES")
    return [] if folder is None else sorted(str(path) for path in Path(folder).glob("*/scene.xml"))


def _sized(source: str, size: tuple[int, int]) -> Scene:
    scene = load(source)
    width, height = size
    return replace(scene, camera=replace(scene.camera, width=width, height=height, crop=None, full_size=None))


def compare_kernels(
    device: str,
    progress: Progress,
    scenes: Sequence[str] = (effects_scenes.DIFFUSE, effects_scenes.EVERYTHING),
    ways: Sequence[dict[str, Any]] = WAYS,
    allowance: Allowance | None = None,
) -> dict[str, KernelRecord]:
    """Render small scenes on the CPU, and repeat each launch on the device.

    Args:
        scenes: of `wdpm bench effects`.
        ways: settings to render each with.
        allowance: of time; None for as much as it takes.
    """
    comparison = LaunchComparison(device)
    progress.start("kernels", len(scenes) * len(ways))
    every = [(f"kernels of {name}, {_in_words(way)}", (name, way)) for name in scenes for way in ways]
    for name, way in (allowance or Allowance(math.inf)).of(every):
        scene = effects_scenes.scene_of(name, SMALL)
        if name in FILTERS:
            scene = replace(scene, camera=replace(scene.camera, filter=FILTERS[name]))
        with comparison.watching():
            render_in_process(scene, replace(FEW, **way), workers=2, cells=2, threads=1)
        progress.advance()
    return comparison.kernels


def _in_words(way: dict[str, Any]) -> str:
    return ", ".join(f"{name} {value.value}" for name, value in way.items())


def compare_images(name: str, scene: Scene, settings: RenderSettings, backends: Sequence[Backend]) -> SceneBits:
    """Render a scene twice with each backend.

    Args:
        backends: the CPU, the device, a mixed cluster.
    """
    seconds, digests = [], []
    for backend in backends:
        _render(scene, backend, settings)
        began = time.perf_counter()
        digests.append(_render(scene, backend, settings).digest())
        seconds.append(time.perf_counter() - began)
    cpu, device, mixed = digests
    return SceneBits(name, (seconds[0], seconds[1], seconds[2]), device == cpu, mixed == cpu)


def _render(scene: Scene, backend: Backend, settings: RenderSettings) -> Image:
    return render_in_passes(scene, backend, settings)


def measure(
    device: str,
    progress: Progress,
    settings: RenderSettings,
    *,
    scenes: Sequence[str] = (),
    size: tuple[int, int] = (256, 192),
    threads: int,
    kernels: Callable[..., dict[str, KernelRecord]] = compare_kernels,
    budget: float = 540.0,
) -> DeviceFigures:
    """All of it: kernels first, then images.

    Args:
        scenes: files or names; none for all, see `scenes_to_render`.
        budget: after this nothing is begun, nor what would end later if it took as long as the longest so far [s].
    """
    allowance = Allowance(budget)
    records = kernels(device, progress, allowance=allowance)
    orders = [(name, (name, make)) for name, make in scenes_to_render(scenes, size)]
    rows: list[SceneBits] = []
    progress.start("images", len(orders))
    with (
        # Not in this process: where CUDA has run, none may be forked, as the CPU's cores are kept busy by.
        MixedCluster(("cpu",), threads) as cpu,
        InProcess(threads=threads, device=device) as other,
        MixedCluster(("cpu", device), threads) as both,
    ):
        for name, make in allowance.of(orders):
            rows.append(compare_images(name, make(), settings, (cpu, other, both)))
            progress.advance()
    unseen = tuple(name for name in all_kernels(trees=False) if name not in records)
    words = str(wp.get_device(device).name)
    return DeviceFigures((device, words), records, unseen, tuple(rows), tuple(allowance.left_out))
