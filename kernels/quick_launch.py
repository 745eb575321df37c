"""Launches on the CPU that take a few microseconds of the interpreter's time, where Warp's own take some twenty.

A cell whose rays come from other processes launches kernels for some hundred of them at a time, and a launch of Warp
looks at its module, its device, its tape and each argument anew before it calls the kernel. A kernel that Warp has
launched once is called directly here: with its bounds, and a struct of its arguments. Warp has no public way for that,
so it is done only with versions of Warp that tests have seen it with (warp_versions.py); whatever is not as expected
(an array of another type, a kernel that is not compiled yet) is left to Warp, which says what is wrong with it.
"""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Sequence
from typing import Any, Final

import warp as wp

from wdpm.kernels.host_arrays import HostArray
from wdpm.kernels.warp_versions import is_tried


class _Entry:
    """How a kernel is called.

    Args:
        kernel: over one dimension, not generic.
        command: a launch of it that Warp has recorded. It is not kept: it holds its arguments, a scene and its photons.
    """

    def __init__(self, kernel: wp.Kernel, command: Any) -> None:
        kinds = [argument.type for argument in kernel.adj.args]
        packed = [type(value) for value in command.params[1:]]
        self._code = command.module_exec  # stays in memory as long as this
        self._forward = command.hooks.forward
        self._bounds = type(command.bounds)
        self._items = [(kind.dtype, kind.ndim) if wp.types.is_array(kind) else None for kind in kinds]
        self._structs = [hasattr(kind, "vars") for kind in kinds]
        members = [(f"argument_{place}", kind) for place, kind in enumerate(packed)]
        self._arguments: type[ctypes.Structure] = type("Arguments", (ctypes.Structure,), {"_fields_": members})

    def call(self, count: int, inputs: Sequence[Any]) -> bool:
        """Call the kernel for items 0 to count - 1; False if it has not been, as an argument is not as expected."""
        values: list[Any] = []
        for value, items, struct in zip(inputs, self._items, self._structs, strict=True):
            if items is not None:
                kind = type(value)
                if not (kind is HostArray or kind is wp.array) or value.dtype is not items[0] or value.ndim != items[1]:
                    return False
                values.append(value.__ctype__())
            elif struct:
                values.append(value.__ctype__())
            elif isinstance(value, int | float):
                values.append(value)
            else:
                return False
        arguments = self._arguments(*values)
        self._forward(ctypes.byref(self._bounds((count,))), ctypes.byref(arguments))
        return True


_entries: Final[weakref.WeakKeyDictionary[wp.Kernel, _Entry]] = weakref.WeakKeyDictionary()


def launch(kernel: wp.Kernel, count: int, inputs: Sequence[Any], device: str) -> None:
    """Launch a kernel for items 0 to count - 1.

    Args:
        inputs: of all arguments, in their order.
    """
    entry = _entries.get(kernel) if device == "cpu" and count else None
    if entry is not None and entry.call(count, inputs):
        return
    wp.launch(kernel, count, inputs=inputs, device=device)
    if entry is None and device == "cpu" and count and is_tried() and _is_plain(kernel):
        _entries[kernel] = _Entry(kernel, wp.launch(kernel, count, inputs=inputs, device=device, record_cmd=True))


def _is_plain(kernel: wp.Kernel) -> bool:
    """Whether a kernel takes structs, arrays and numbers alone, over one dimension."""
    kinds = [argument.type for argument in kernel.adj.args]
    known = all(wp.types.is_array(kind) or hasattr(kind, "vars") or kind in _NUMBERS for kind in kinds)
    return known and not kernel.is_generic and kernel.adj.kernel_dim == 1


_NUMBERS: Final = frozenset({wp.int32, wp.uint32, wp.int64, wp.float32, wp.float64, wp.bool})
