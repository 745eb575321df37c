"""Renders on this machine: in this process, or with slaves that it starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from wdpm.cluster.cluster_events import ClusterObserver
from wdpm.cluster.display import Display
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.render_settings import RenderSettings
from wdpm.images.image import Image
from wdpm.rendering.backend import Backend
from wdpm.rendering.cache_file import CacheFiles
from wdpm.rendering.compiling import Compiling
from wdpm.rendering.in_process import InProcess
from wdpm.rendering.passes import render_in_passes
from wdpm.rendering.prepare import Source


def backend_here(
    slaves: int = 0,
    threads: int | None = None,
    device: str = "cpu",
    copies: Copies = Copies.AUTO,
    memory: int | None = None,
    observers: Sequence[ClusterObserver] = (),
    compiling: Compiling = Compiling.FIRST,
) -> Backend:
    """What renders on this machine: slave processes, or with none of them this process.

    Args:
        threads: cores to use in all; None for all there are.
        device: "cpu" or a CUDA device, "cuda:0".
        copies, memory: of slaves, see Cluster.local.
        observers: are told what happens.
        compiling: when a scene's kernels are compiled, if they have not been.
    """
    shared: Mapping[str, Any] = {
        "threads": threads,
        "device": device,
        "observers": observers,
        "compiling": compiling,
    }
    if not slaves:
        return InProcess(**shared)
    from wdpm.clusters import Cluster  # who renders alone waits for nothing that clusters need

    return Cluster.local(slaves, copies=copies, memory=memory, **shared)


def render_here(
    source: Source,
    settings: RenderSettings,
    *,
    options: Mapping[str, Any],
    display: Display | None = None,
    save_cache: Path | None = None,
    load_cache: Path | None = None,
    **how: Any,
) -> Image:
    """What `wdpm render` does: as `wdpm.render`, which has the arguments.

    Args:
        options: slaves, threads, device, copies, memory, observers and compiling, see backend_here.
        how: progress and journals.
    """
    with backend_here(**options) as backend:
        backend.display = display
        return render_in_passes(source, backend, settings, cache=CacheFiles(save_cache, load_cache), **how)
