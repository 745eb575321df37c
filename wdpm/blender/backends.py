"""Who renders for Blender: this process, or slaves that stay from one render to the next."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from wdpm.clusters import Cluster
from wdpm.rendering.backend import Backend
from wdpm.rendering.in_process import InProcess


class Backends:
    """Keeps a cluster as long as the same one is asked for."""

    def __init__(self) -> None:
        self._cluster: Cluster | None = None
        self._asked: tuple[str, int, Path | None] | None = None

    @contextmanager
    def here(self, threads: int | None) -> Iterator[Backend]:
        """This process.

        Args:
            threads: cores to use; None for all there are.
        """
        with InProcess(threads=threads) as backend:
            yield backend

    @contextmanager
    def cluster(self, address: str, slaves: int, keys: Path | None) -> Iterator[Backend]:
        """Slaves that people start with `wdpm slave ADDRESS`. They stay, unless the render fails or is cancelled.

        Raises:
            SettingsError, ClusterError: as Cluster.listen.
        """
        asked = (address, slaves, keys)
        if self._cluster is None or self._asked != asked:
            self.close()
            self._cluster, self._asked = Cluster.listen(address, slaves, keys=keys), asked
        cluster = self._cluster
        try:
            yield cluster
        except BaseException:
            self.close()
            raise
        cluster.display = None

    def close(self) -> None:
        """Let go of the cluster's slaves; may be called again."""
        cluster, self._cluster, self._asked = self._cluster, None, None
        if cluster is not None:
            cluster.close()


BACKENDS = Backends()
"""Of this Blender."""
