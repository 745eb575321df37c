"""Renders on this machine: in this process, or with slaves that it starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from wdpm.cluster.cluster_events import ClusterObserver
from wdpm.cluster.plan.copies import Copies
from wdpm.devices import check_count
from wdpm.rendering.backend import Backend
from wdpm.rendering.compiling import Compiling
from wdpm.rendering.in_process import InProcess


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

    Raises:
        SettingsError: slaves or threads that cannot be.
    """
    check_count("slaves", slaves, 0)
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
