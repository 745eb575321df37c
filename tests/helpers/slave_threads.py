"""Slaves as threads of the test's process, for tests in which nothing has to die; and what their image looks like."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from failures import DifferentBits
from fake_worker import FakeWorker, picture
from patience import WAIT_S
from slow_slaves import AGREED

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.session import Session
from wdpm.cluster.slave.process import run_slave
from wdpm.scenes.errors import ClusterError

SMALL = ClusterLimits(photon_task_paths=64, part_triangles=3)
"""Several tasks and several parts of cells, however small the scene."""


class SlaveThread(threading.Thread):
    """A slave in this process; `error` is what ended it."""

    def __init__(self, endpoint: str, make_worker: Any = FakeWorker, **options: Any) -> None:
        super().__init__(daemon=True)
        self.error: BaseException | None = None
        self._endpoint, self._make_worker = endpoint, make_worker
        self._options = {"agreed": AGREED, "patience": WAIT_S, "tell": lambda _: None, **options}
        self.start()

    def run(self) -> None:
        try:
            run_slave(self._endpoint, self._make_worker, **self._options)
        except ClusterError as error:
            self.error = error

    def end(self) -> BaseException | None:
        """Wait for its end; what ended it."""
        self.join(WAIT_S)
        assert not self.is_alive()
        return self.error


def check_picture(session: Session, layers: dict[str, Any]) -> None:
    """Every layer must be as FakeWorkers paint it, whoever rendered which bucket."""
    for name, layer in picture(session.view).layers.items():
        if not np.array_equal(layers[name], layer):
            raise DifferentBits(f"{name} is {layers[name]}, not {layer}")
