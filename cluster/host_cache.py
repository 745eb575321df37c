"""What is made once a machine: the worker that needs it first makes it, and others on the same machine map it.

Trees, tables and maps are functions of the scene, so it does not matter who makes them, and no bit depends on it. Where
nothing can be shared, each worker makes all by itself.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from wdpm.kernels import packed
from wdpm.kernels.packed import Kind, NotAsExpectedError, Value


class Claim(Protocol):
    """transport.host_share.Claim."""

    @property
    def found(self) -> memoryview | None: ...

    def publish(self, parts: Sequence[memoryview]) -> memoryview | None: ...


class Share(Protocol):
    """transport.host_share.HostShare."""

    def claim(self, name: str, *, wait: bool = True) -> AbstractContextManager[Claim | None]: ...


@dataclass(frozen=True)
class CacheEntry:
    """Values that a worker needs, which it makes or maps.

    Attributes:
        name: what it is, in this scene.
        kinds: its structs, or `dict` for numpy arrays by name.
        make: gives values of these kinds.
        private: whether no other worker has use for it.
    """

    name: str
    kinds: tuple[Kind, ...]
    make: Callable[[], Sequence[Value]]
    private: bool = False


class HostCache:
    """What workers of one scene on one machine share.

    Args:
        share: with whom; None for nobody.
        scene: names it: equal names are equal scenes, but for their photon plans.
        in_main_memory: whether what is made here lies where others can map it, and they would have use for it.

    Attributes:
        unshared: entries that were made here for this worker alone, since the system or a process that stands still
            forbade more.
        found_some: whether something was mapped that another worker has made: so others can map what lies here.
    """

    def __init__(self, share: Share | None = None, scene: str = "", *, in_main_memory: bool = True) -> None:
        self._share = share if scene else None
        self._scene = scene
        self._in_main_memory = in_main_memory
        self.unshared = 0
        self.found_some = False

    @property
    def is_shared(self) -> bool:
        """Whether workers of this machine make things for each other: all of them say the same."""
        return self._share is not None

    def get(self, entry: CacheEntry) -> Sequence[Value]:
        """Values that are made here or mapped."""
        return self.get_all([entry])[0]

    def get_all(self, entries: Sequence[CacheEntry], first: int = 0) -> list[Sequence[Value]]:
        """Values of several, in their order.

        Args:
            first: which one to make first. Where each worker begins with another one, they are made at the same time.
        """
        if self._share is None or not self._in_main_memory:
            return [each.make() for each in entries]
        got: dict[int, Sequence[Value]] = {index: each.make() for index, each in enumerate(entries) if each.private}
        order = [(first + index) % len(entries) for index in range(len(entries))]
        for wait in (False, True):  # what others are at comes last
            for index in order:
                if index not in got:
                    with self._share.claim(f"{self._scene} {entries[index].name}", wait=wait) as claim:
                        if claim is not None:
                            self.found_some |= claim.found is not None
                            got[index], shared = _values_of(claim, entries[index])
                            self.unshared += not shared
        return [got[index] for index in range(len(entries))]

    def lend(self, name: str, arrays: Callable[[], Mapping[str, NDArray[Any]]], *, surely: bool = False) -> Any:
        """Have others map arrays that only this worker has, in place of what had this name before.

        Args:
            arrays: gives them; called if anybody could map them.
            surely: also if nothing tells that others could map them, or what this worker makes lies elsewhere.

        Returns:
            what keeps them there; None if they are not.
        """
        if self._share is None or not (surely or (self._in_main_memory and self.found_some)):
            return None
        with self._share.claim(f"{self._scene} {name}") as claim:
            return None if claim is None else claim.publish(packed.pack(name, [dict(arrays())]))

    def borrow(self, name: str) -> Mapping[str, NDArray[Any]] | None:
        """The arrays that another worker lends, where they lie, read-only; None if they are not to be had."""
        if self._share is None:
            return None
        with self._share.claim(f"{self._scene} {name}") as claim:
            if claim is None or claim.found is None:
                return None
            try:
                found: Mapping[str, NDArray[Any]]
                (found,) = packed.unpack(name, (dict,), claim.found)
            except NotAsExpectedError:
                return None
            return found


def _values_of(claim: Claim, entry: CacheEntry) -> tuple[Sequence[Value], bool]:
    """Values, and whether others may have them too."""
    if claim.found is not None:
        try:
            return packed.unpack(entry.name, entry.kinds, claim.found), True
        except NotAsExpectedError:
            pass  # of a process that is not what it says it is: it is made here, as if nothing had been there
    made = entry.make()
    memory = claim.publish(packed.pack(entry.name, made))
    # Of what was made here and what others map, one is enough.
    return (made, False) if memory is None else (packed.unpack(entry.name, entry.kinds, memory), True)


def name_of(arrays: Mapping[str, NDArray[Any]]) -> str:
    """A name that other arrays do not have: a digest of all that they hold."""
    digest = hashlib.blake2b(digest_size=16)
    for name, array in arrays.items():
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
    return digest.hexdigest()
