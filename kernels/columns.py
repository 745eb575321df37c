"""Items as structs of Warp, and many of them as structures of arrays: one array a field, all equally long.

Both are made of the same table of fields (fields.py), and so are the functions that load and store an item.
"""

from __future__ import annotations

import functools
import linecache
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels import blocks, host_arrays, host_columns
from wdpm.kernels.fields import Field, Fields
from wdpm.kernels.host_arrays import HostArray
from wdpm.kernels.host_columns import HostColumns, HostNest

_WARP_TYPES = {
    ("<i4", ()): wp.int32,
    ("<i8", ()): wp.int64,
    ("<f4", ()): wp.float32,
    ("<f4", (3,)): wp.vec3,
    ("<f8", ()): wp.float64,
    ("<f8", (3,)): wp.vec3d,
}


class FromFields:
    """What structs are classes of that get their members from a table of fields: a type checker knows none of those."""

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...

        def __setattr__(self, name: str, value: Any) -> None: ...


def item_of(fields: Fields) -> Callable[[type], wp.Struct]:
    """Makes a class a Warp struct of one item: the fields, then what the class declares itself."""
    return lambda cls: _struct(cls, {name: _warp_type(field) for name, field in fields.items()})


def columns_of(fields: Fields) -> Callable[[type], wp.Struct]:
    """Makes a class a Warp struct of arrays: one for each field, then what the class declares itself."""
    return lambda cls: _struct(cls, {name: wp.array[_warp_type(field)] for name, field in fields.items()})


def _warp_type(field: Field) -> Any:
    return _WARP_TYPES[field.dtype, field.shape]


def _struct(cls: type, members: dict[str, Any]) -> wp.Struct:
    cls.__annotations__ = {**members, **cls.__annotations__}
    return wp.struct(cls)


def loader(columns: wp.Struct, item: wp.Struct) -> wp.Function:
    """A function of kernels, load(columns, i): item i. Members without an array are zero."""
    lines = [f"    item.{member} = columns.{name}[i]" for name, member in _shared(columns, item)]
    signature = f"def load_{item.key}_of_{columns.key}(columns: wp.ref[Columns], i: wp.int32) -> Item:"
    return _function([signature, "    item = Item()", *lines, "    return item"], columns, item)


def storer(columns: wp.Struct, item: wp.Struct) -> wp.Function:
    """A function of kernels, store(item, i, columns_out): writes item i, as far as there are arrays for its members."""
    lines = [f"    columns_out.{name}[i] = item.{member}" for name, member in _shared(columns, item)]
    signature = f"def store_{item.key}_in_{columns.key}(item: Item, i: wp.int32, columns_out: wp.ref[Columns]) -> None:"
    return _function([signature, *lines], columns, item)


def _shared(columns: wp.Struct, item: wp.Struct) -> list[tuple[str, str]]:
    """Names of arrays, and the members that they are of, be they those of a struct inside the item."""
    members = {}
    for name, var in item.vars.items():
        inner = getattr(var.type, "vars", ())  # of a struct
        members.update({name: name} if not inner else {each: f"{name}.{each}" for each in inner})
    return [(name, members[name]) for name in columns.vars if name in members]


def _function(lines: list[str], columns: wp.Struct, item: wp.Struct) -> wp.Function:
    """A function of Warp with this source, in the module of the arrays' struct. Warp reads sources by linecache."""
    source = "\n".join(lines) + "\n"
    name = lines[0].split("(")[0].removeprefix("def ")
    file = f"<{columns.__module__}.{name}>"
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    scope = {"wp": wp, "Columns": columns, "Item": item, "__name__": columns.__module__}
    exec(compile(source, file, "exec"), scope)
    return wp.func(scope[name])


def _layout_on(struct: wp.Struct, device: str) -> host_columns.Layout | None:
    """How the struct's columns lie on the CPU, where they need no arrays of Warp; None for Warp's own instances."""
    return host_columns.layout_of(struct) if blocks.shares_memory(device) else None


def upload(
    struct: wp.Struct, arrays: Mapping[str, NDArray[Any]], device: str, written: Collection[str] | None = None
) -> Any:
    """An instance of a Warp struct whose array fields hold the arrays of the same names.

    On the CPU they share memory with arrays that may be written to, so a kernel that refines them in place refines the
    caller's; what came over a wire is read-only, and is copied where it is written to. To another device all go in one
    copy.

    Args:
        written: the columns that kernels write to; None for all.
    """
    layout = _layout_on(struct, device)
    if layout is not None:
        return host_columns.over(layout, arrays, written)
    columns = struct()
    dtypes = _dtypes(struct)
    if not blocks.shares_memory(device):
        made = blocks.from_host([arrays[name] for name in dtypes], list(dtypes.values()), device)
        return _fill(columns, dtypes, made)
    for name, dtype in dtypes.items():
        array = np.ascontiguousarray(arrays[name])
        copy = not array.flags.writeable
        setattr(columns, name, wp.array(array, dtype=dtype, device=device, copy=copy))
    return columns


@functools.cache
def _dtypes(struct: wp.Struct) -> dict[str, Any]:
    """Warp's type of the items of each column."""
    return {name: var.type.dtype for name, var in struct.vars.items()}


def _fill(columns: Any, names: Iterable[str], arrays: Iterable[Any]) -> Any:
    for name, array in zip(names, arrays, strict=True):
        setattr(columns, name, array)
    return columns


def struct_of(value: Any) -> wp.Struct | None:
    """The Warp struct that a kernel takes a value for, be it Warp's own instance of it or one of columns; or None."""
    if isinstance(value, HostColumns | HostNest):
        return value.of_struct
    struct = getattr(value, "_cls", None)  # Warp has no public name for what its instances are of
    return struct if hasattr(struct, "vars") else None


def part_of(struct: wp.Struct, columns: Any) -> Any:
    """An instance of a Warp struct whose array fields are another's of the same names: nothing is copied."""
    if isinstance(columns, HostColumns):
        return upload(struct, {name: columns.column(name) for name in struct.vars}, "cpu")
    part = struct()
    for name in struct.vars:
        setattr(part, name, getattr(columns, name))
    return part


def empty(struct: wp.Struct, count: int, device: str) -> Any:
    """An instance of a Warp struct whose array fields have `count` items of no particular value."""
    return _none(struct, device) if count == 0 else _empty(struct, count, device)


@functools.cache
def _none(struct: wp.Struct, device: str) -> Any:
    """Columns without items are all alike: kernels that a scene has no use for some of their outputs get these."""
    return _empty(struct, 0, device)


def _empty(struct: wp.Struct, count: int, device: str) -> Any:
    layout = _layout_on(struct, device)
    if layout is not None:
        return host_columns.room(layout, count)
    columns = struct()
    _make_room(struct, columns, count, device)
    return columns


def empty_nested(struct: wp.Struct, counts: Mapping[str, int], device: str) -> Any:
    """An instance of a Warp struct of structs of arrays.

    Args:
        counts: items of each of the inner structs, of no particular value; without any, its arrays are not there.
    """
    others = host_columns.without_layout(struct) if blocks.shares_memory(device) else None
    if others is not None:
        warps = {name: _some_or_blank(struct.vars[name].type, counts.get(name, 0), device) for name in others}
        return HostNest(struct, counts, warps)
    nested = struct()
    for name, count in counts.items():
        if count:
            _make_room(struct.vars[name].type, getattr(nested, name), count, device)
    return nested


def _some_or_blank(struct: wp.Struct, count: int, device: str) -> Any:
    return _empty(struct, count, device) if count else _blank(struct)


@functools.cache
def _blank(struct: wp.Struct) -> Any:
    """An instance without arrays."""
    return struct()


def are_there(columns: Any) -> bool:
    """Whether columns were made with items."""
    if isinstance(columns, HostColumns):
        return columns.has_arrays
    return any(getattr(columns, name) is not None for name in columns._cls.vars)


def _make_room(struct: wp.Struct, columns: Any, count: int, device: str) -> None:
    dtypes = _dtypes(struct)
    _fill(columns, dtypes, blocks.room(list(dtypes.values()), count, device))


def zeros(struct: wp.Struct, count: int, device: str) -> Any:
    """An instance of a Warp struct whose array fields have `count` zeros."""
    columns = struct()
    for name, var in struct.vars.items():
        setattr(columns, name, wp.zeros(count, dtype=var.type.dtype, device=device))
    return columns


def chosen(struct: wp.Struct, columns: Any, rows: NDArray[np.intp], device: str) -> Any:
    """Some items of an instance of a Warp struct, as another instance."""
    if blocks.shares_memory(device):
        return upload(struct, {name: column(columns, name).take(rows, axis=0) for name in struct.vars}, device)
    some = rows_of({name: getattr(columns, name) for name in struct.vars}, rows, device)
    return _fill(struct(), some, some.values())


def outputs(dtypes: Mapping[str, Any], count: int, device: str) -> dict[str, Any]:
    """Arrays of `count` items of no particular value, by name: what a kernel writes besides a struct's columns."""
    kinds = list(dtypes.values())
    made = host_arrays.room(kinds, count) if blocks.shares_memory(device) else blocks.room(kinds, count, device)
    return dict(zip(dtypes, made, strict=True))


def array_over(array: NDArray[Any], dtype: Any, device: str) -> Any:
    """What a kernel takes for an array of numpy; on the CPU it shares memory with one that is contiguous.

    Args:
        array: of the shape that belongs to `dtype`.
        dtype: Warp's type of its items.
    """
    if blocks.shares_memory(device):
        return HostArray(np.ascontiguousarray(array, host_arrays.known_by_numpy(dtype)[0]), dtype)
    return wp.array(array, dtype=dtype, device=device)


def integers(count: int, device: str) -> Any:
    """An array of `count` int32 of no particular value."""
    if blocks.shares_memory(device):
        return HostArray(np.empty(count, np.int32), wp.int32)
    return wp.empty(count, dtype=wp.int32, device=device)


def rows_of(arrays: Mapping[str, Any], rows: NDArray[np.intp], device: str) -> dict[str, Any]:
    """Some items of arrays, in that order, as other arrays. A device with memory of its own gathers them there."""
    if blocks.shares_memory(device):
        return {name: HostArray(array.numpy().take(rows, axis=0), array.dtype) for name, array in arrays.items()}
    some = outputs({name: array.dtype for name, array in arrays.items()}, len(rows), device)
    if len(rows):
        indices = wp.array(rows, dtype=wp.int32, device=device)
        for name, array in arrays.items():
            wp.copy(some[name], array[indices])
    return some


def member(columns: Any, name: str, of_struct: str) -> NDArray[Any]:
    """One member of a column of structs, as a numpy array: on the CPU nothing is copied."""
    structs = column(columns, name)
    array: NDArray[Any] = structs[of_struct]
    return array


def to_host(arrays: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Arrays as numpy arrays; on the CPU they share memory with the device's."""
    if all(type(array) is HostArray or blocks.shares_memory(array.device.alias) for array in arrays.values()):
        return {name: array.numpy() for name, array in arrays.items()}
    return blocks.to_host(arrays)


def column(columns: Any, name: str) -> NDArray[Any]:
    """One of the arrays as a numpy array; on the CPU it shares memory with the device's."""
    array: NDArray[Any] = columns.column(name) if isinstance(columns, HostColumns) else getattr(columns, name).numpy()
    return array


def argument(columns: Any, name: str) -> Any:
    """One of the arrays, for a kernel that takes it alone."""
    return columns.array(name) if isinstance(columns, HostColumns) and columns.has_arrays else getattr(columns, name)


def length(columns: Any, name: str) -> int:
    """How many items one of the arrays has."""
    return len(column(columns, name) if isinstance(columns, HostColumns) else getattr(columns, name))


def download(columns: Any, names: Iterable[str]) -> dict[str, NDArray[Any]]:
    """The named arrays as numpy arrays; on the CPU they share memory with the device's."""
    if isinstance(columns, HostColumns):
        return columns.some(names)
    return to_host({name: getattr(columns, name) for name in names})


def download_parts(
    columns: Any, names: Iterable[str], parts: Iterable[tuple[int, int]]
) -> Iterator[dict[str, NDArray[Any]]]:
    """Parts of the named arrays as numpy arrays: on the CPU in the same memory, else no more than these are copied.

    Args:
        parts: first item and number of items of each.
    """
    if isinstance(columns, HostColumns):
        there = {name: columns.column(name) for name in names}
    else:
        arrays = {name: getattr(columns, name) for name in names}
        device = next(iter(arrays.values())).device.alias
        if not blocks.shares_memory(device):
            for first, count in parts:
                packed = outputs({name: array.dtype for name, array in arrays.items()}, count, device)
                for name, array in arrays.items():
                    wp.copy(packed[name], array, src_offset=first, count=count)
                yield blocks.to_host(packed)
            return
        there = {name: array.numpy() for name, array in arrays.items()}
    for first, count in parts:
        yield {name: array[first : first + count] for name, array in there.items()}
