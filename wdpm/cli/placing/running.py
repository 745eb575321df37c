"""A render whose slaves Slurm, Dask or SSH places, and a slave that Slurm has placed."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wdpm.cli.monitoring import observers
from wdpm.cli.output.image import chosen_way
from wdpm.cluster.cluster_events import ClusterObserver
from wdpm.cluster.plan.copies import Copies
from wdpm.scenes.errors import ClusterError, SettingsError

if TYPE_CHECKING:
    from wdpm.clusters import Cluster

Observers = Sequence[ClusterObserver]


def render_placed(args: argparse.Namespace) -> int:
    """Render and write, or be a slave; returns the exit code."""
    way = chosen_way(args)
    if not args.slurm:
        with (
            observers(args) as cluster_observers,
            _on_dask(args, cluster_observers) if args.dask else _over_ssh(args, cluster_observers) as cluster,
        ):
            return way(args, lambda: cluster)
    from wdpm.placing.slurm import this_allocation

    allocation = this_allocation()
    if allocation.rank > 0:
        return _serve_in_slurm(args, allocation)
    from wdpm.clusters import Cluster

    # Open before the scene is loaded: slaves need not be patient, and hear of it if that fails.
    with (
        observers(args) as cluster_observers,
        Cluster.in_slurm(allocation, args.shared or Path(), **_how(args, cluster_observers)) as cluster,
    ):
        return way(args, lambda: cluster)


def _serve_in_slurm(args: argparse.Namespace, allocation: Any) -> int:
    from wdpm.placing.rendezvous import meet, meeting_folder
    from wdpm.serving import serve

    found = meet(meeting_folder(args.shared or Path(), allocation.name), allocation.rank, allocation.tasks - 1)
    threads, memory = args.threads or allocation.threads, args.memory or allocation.memory
    serve(found.endpoint, found.security, threads=threads, device=args.device, memory=memory)
    return 0


@contextmanager
def _on_dask(args: argparse.Namespace, cluster_observers: Observers) -> Iterator[Cluster]:
    from wdpm.clusters import Cluster

    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise SettingsError(f"--dask needs the extra: pip install 'wdpm[dask]' ({error})") from None
    try:
        client = Client(args.dask)
    except OSError as error:
        reason = str(error).partition("\n")[0]
        raise ClusterError(f"no scheduler of Dask answers at {args.dask}: {reason}") from None
    how = _how(args, cluster_observers)
    with client, Cluster.on_dask(client, args.slaves or None, device=args.device, **how) as cluster:
        yield cluster


def _over_ssh(args: argparse.Namespace, cluster_observers: Observers) -> Cluster:
    from wdpm.clusters import Cluster

    return Cluster.over_ssh(
        args.hosts,
        memory=args.memory,
        threads=args.threads,
        device=args.device,
        remote_wdpm=args.remote_wdpm or "wdpm",
        **_how(args, cluster_observers),
    )


def _how(args: argparse.Namespace, cluster_observers: Observers) -> dict[str, Any]:
    """What all clusters are told alike."""
    how = {"copies": args.copies or Copies.AUTO, "observers": cluster_observers}
    return how if args.join_timeout is None else {**how, "join_timeout": args.join_timeout}
