"""Every launch of a render repeated on another device, on the same input: which kernel gives other bits, and where."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any
from unittest import mock

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.bench.gpu.names import plain_name
from wdpm.cluster.work.whole.launches import TraceLaunches
from wdpm.kernels import columns
from wdpm.kernels.host_arrays import HostArray
from wdpm.kernels.launch import Launcher, arguments_of
from wdpm.kernels.photons.deposits import Deposits

Launches = Sequence[tuple[int, Sequence[Any]]]


@dataclass(frozen=True)
class Difference:
    """The first element in which two devices differ.

    Attributes:
        argument: of the kernel, with the members that lead to the array: `rays.t`.
        index: of the element, in all dimensions of the array.
        expected: what the CPU gave.
        got: what the device gave.
        count: elements of this array that differ.
    """

    argument: str
    index: tuple[int, ...]
    expected: str
    got: str
    count: int

    def __str__(self) -> str:
        return (
            f"{self.argument}[{', '.join(map(str, self.index))}] is {self.got}, expected {self.expected} "
            f"({self.count:,} differ)"
        )


@dataclass
class KernelRecord:
    """What was seen of one kernel.

    Attributes:
        launches, items: how many.
        differing: launches that gave other bits.
        first: the first difference there was.
    """

    launches: int = 0
    items: int = 0
    differing: int = 0
    first: Difference | None = None


@dataclass
class LaunchComparison:
    """Repeats launches on a device.

    Attributes:
        device: a Warp device name.
        kernels: what was seen, by name of the kernel.
    """

    device: str
    kernels: dict[str, KernelRecord] = field(default_factory=dict)

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Repeat all launches of `Launcher` on the CPU meanwhile.

        One thread of the program at a time. What a kernel of the CPU alone would do is done by those that devices have.
        """
        run = Launcher.run

        def run_twice(launcher: Launcher, kernel: wp.Kernel, launches: Launches) -> None:
            repeat = Repeat(self.device, launches)  # the input is copied before a kernel refines it in place
            run(launcher, kernel, launches)
            repeat.run(kernel)
            self._compare(kernel, repeat)

        with mock.patch.object(Launcher, "run", run_twice), mock.patch.object(TraceLaunches, "can_be", False):
            yield

    def _compare(self, kernel: wp.Kernel, repeat: Repeat) -> None:
        record = self.kernels.setdefault(plain_name(kernel.key), KernelRecord())
        record.launches += 1
        record.items += repeat.items
        differences = repeat.differences(arguments_of(kernel)[0])
        record.differing += bool(differences)
        record.first = record.first or (differences[0] if differences else None)


class Repeat:
    """The arguments of a kernel's launches, copied to a device.

    Args:
        launches: as `Launcher.run` takes them: each a number of items and all arguments.
    """

    def __init__(self, device: str, launches: Launches) -> None:
        self.device = device
        self.items = sum(size for size, _ in launches)
        self._arrays: dict[tuple[Any, ...], wp.array] = {}  # what two arguments share they share on the device as well
        self._original = launches
        self._copied = [(size, [self._copy(value) for value in values]) for size, values in launches]

    def run(self, kernel: wp.Kernel) -> None:
        """Launch the kernel, and wait for it."""
        for size, values in self._copied:
            wp.launch(kernel, size, inputs=values, device=self.device)
        wp.synchronize_device(self.device)

    def differences(self, names: Sequence[str]) -> list[Difference]:
        """The first difference of each array that has one, by the order of the arguments' names."""
        found = []
        (_, original), (_, copied) = self._original[0], self._copied[0]  # all launches have the same arrays
        for name, before, after in zip(names, original, copied, strict=True):
            for path, expected, got in _pairs(name, before, after):
                difference = first_difference(path, expected, got)
                if difference is not None:
                    found.append(difference)
        return found

    def _copy(self, value: Any) -> Any:
        if isinstance(value, HostArray):
            return self._copy_array(value.of_warp())
        if isinstance(value, wp.array):
            return self._copy_array(value)
        struct = columns.struct_of(value)
        if struct is None:
            return value
        copy = struct()
        for name in struct.vars:
            member = getattr(value, name)
            if member is not None:  # of columns without arrays
                setattr(copy, name, self._copy(member))
        return copy

    def _copy_array(self, array: wp.array) -> wp.array:
        key = (array.ptr, array.shape, array.dtype)
        if array.size == 0 or key not in self._arrays:
            self._arrays[key] = wp.clone(array, device=self.device)
        return self._arrays[key]


def _pairs(path: str, expected: Any, got: Any) -> Iterator[tuple[str, NDArray[Any], NDArray[Any]]]:
    """Arrays of one value of an argument and of its copy, with where they are."""
    if isinstance(expected, wp.array | HostArray):
        if len(expected):
            yield path, expected.numpy(), got.numpy()
        return
    struct = columns.struct_of(expected)
    if struct is not None:
        if struct is Deposits:
            expected, got = _Sorted(expected), _Sorted(got)
        for name in struct.vars:
            yield from _pairs(f"{path}.{name}", getattr(expected, name), getattr(got, name))


class _Sorted:
    """Stored photons of a launch, by number: threads take places as they come, and their order has no say in a map."""

    def __init__(self, deposits: Any) -> None:
        self.capacity = deposits.capacity
        self.count = deposits.count
        counts = np.minimum(deposits.count.numpy(), deposits.capacity)
        rows = np.concatenate([chunk * deposits.capacity + np.arange(count) for chunk, count in enumerate(counts)])
        rows = rows[np.argsort(deposits.photons.id.numpy()[rows], kind="stable")]
        struct = columns.struct_of(deposits.photons)
        assert struct is not None
        sorted_photons = {name: getattr(deposits.photons, name).numpy()[rows] for name in struct.vars}
        self.photons = columns.upload(struct, sorted_photons, "cpu")


def first_difference(argument: str, expected: NDArray[Any], got: NDArray[Any]) -> Difference | None:
    """The first element with other bits, or None.

    What is not a number is equal to what is not: processors have bits of their own for it, and nothing reads those.
    """
    if expected.tobytes() == got.tobytes():
        return None
    differs = _bits(expected) != _bits(got)
    if expected.dtype.kind == "f":
        differs &= ~(np.isnan(expected) & np.isnan(got))
    if not differs.any():
        return None
    index = tuple(int(i) for i in np.argwhere(differs)[0])
    return Difference(argument, index, _word(expected[index]), _word(got[index]), int(np.count_nonzero(differs)))


def _bits(array: NDArray[Any]) -> NDArray[Any]:
    """Elements as what compares by bits."""
    return np.ascontiguousarray(array).view(f"V{array.dtype.itemsize}")


def _word(value: Any) -> str:
    """A value with its bits, as two floats may print alike."""
    return f"{value!s} (0x{np.asarray(value).tobytes()[::-1].hex()})" if value.dtype.kind == "f" else str(value)
