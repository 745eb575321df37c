"""What is read beside other reading, in threads of their own: decoders of pictures let others compute meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from contextvars import copy_context
from types import TracebackType
from typing import Generic, Self, TypeVar

Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")


class Ahead(Generic[Key, Value]):
    """Reads things by their keys, some of them before anybody asks. To be used as a context.

    What is wrong with one is told when it is asked for, so errors come in the order of the scene's file.

    Args:
        read: reads what has a key.
        wanted: keys that will be asked for, most likely in this order.
        threads: that read them; one reads nothing ahead.
    """

    def __init__(self, read: Callable[[Key], Value], wanted: Iterable[Key] = (), threads: int = 1) -> None:
        self._read = read
        each = list(dict.fromkeys(wanted)) if threads > 1 else []
        self._pool = ThreadPoolExecutor(threads) if each else None
        self._coming: dict[Key, Future[Value]] = {}
        if self._pool is not None:  # each in the caller's context, which has the scene's root
            self._coming = {key: self._pool.submit(copy_context().run, read, key) for key in each}

    def get(self, key: Key) -> Value:
        """What has a key; what was read ahead is given once.

        Raises:
            Whatever `read` raises.
        """
        coming = self._coming.pop(key, None)
        return self._read(key) if coming is None else coming.result()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Waits for what is being read, and begins no more."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
