"""Pictures that are decoded beside other reading, in threads of their own: decoders let others compute meanwhile."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.images.read import read_texture


class PicturesAhead:
    """Reads pictures as `read_texture` does, some of them before anybody asks. To be used as a context.

    What is wrong with a picture is told when it is asked for, so errors come in the order of the scene's file.

    Args:
        wanted: files that will be asked for, most likely in this order, and whether raw.
        threads: that decode them.
    """

    def __init__(self, wanted: Iterable[tuple[Path, bool]] = (), threads: int = 1) -> None:
        each = list(dict.fromkeys(wanted))
        self._pool = ThreadPoolExecutor(threads) if threads > 1 and each else None
        self._coming: dict[tuple[Path, bool], Future[NDArray[np.float32]]] = {}
        if self._pool is not None:
            self._coming = {(file, raw): self._pool.submit(read_texture, file, raw=raw) for file, raw in each}

    def read(self, file: Path, *, raw: bool) -> NDArray[np.float32]:
        """As `read_texture`; what was read ahead is given once.

        Raises:
            SceneError: as `read_texture`.
        """
        coming = self._coming.pop((file, raw), None)
        return read_texture(file, raw=raw) if coming is None else coming.result()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Waits for what is being read, and begins no more."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
