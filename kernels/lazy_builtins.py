"""Warp's own functions, made when somebody looks at one, not when Warp is imported.

For each of its 355 functions (`dot`, `min`, `normalize`) Warp makes one object for every mix of types that Python may
call it with, 3,600 in all: half the time that its import takes. A process that finds its kernels compiled looks at
none of them, and one that compiles at a few dozen.

So what Warp says of a function while it is imported is written down. What it would have made of that is made, by
Warp's own code, when something of a function is looked up that is not there yet.
"""

from __future__ import annotations

import functools
import importlib.abc
import sys
import threading
import types
from collections.abc import Callable, Mapping
from typing import Any

from wdpm.kernels.warp_versions import is_tried

LIST = "warp._src.builtins"
"""The module of Warp that registers its functions when it is imported."""

CONTEXT = "warp._src.context"
"""The module of Warp that has `add_builtin`, which does that, and `builtin_functions`, where they are found by name."""

Calls = list[tuple[tuple[Any, ...], Mapping[str, Any]]]
"""Arguments of each call that registers a function of one name: it has as many overloads, or more."""

_lock = threading.RLock()


class _Watch(importlib.abc.MetaPathFinder):
    """Finds nothing. Is asked before Warp's list of functions is read, when what that uses is there."""

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> None:  # noqa: ARG002
        """As Python asks every finder."""
        if fullname == LIST:
            sys.meta_path.remove(self)
            if is_tried():
                _put_off(sys.modules[CONTEXT])


def make_lazily() -> None:
    """Have Warp's functions made late, if Warp was not imported yet; may be called again."""
    if LIST not in sys.modules and not any(isinstance(finder, _Watch) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Watch())


def _put_off(context: Any) -> None:
    """Have what is registered from here on written down."""
    make = context.add_builtin
    late = _late_class(context)

    @functools.wraps(make)
    def add_builtin(key: str, *arguments: Any, **keywords: Any) -> None:
        known = context.builtin_functions.get(key)
        if known is None:
            function = late.__new__(late)
            function.__dict__.update(key=key, func=None, _calls=[(arguments, keywords)], _make=make)
            context.builtin_functions[key] = function
            if keywords.get("export", True):
                setattr(sys.modules["warp"], key, function)
        elif type(known) is late:
            known.__dict__["_calls"].append((arguments, keywords))
        else:
            make(key, *arguments, **keywords)

    context.add_builtin = add_builtin


def _late_class(context: Any) -> Any:
    """Of Warp's functions that are not made yet. Warp's class is known when Warp is being imported, not before."""

    def missing(function: Any, name: str) -> Any:
        if name.startswith("__"):  # Python asks everything for these
            raise AttributeError(name)
        _finish(function, context)
        return getattr(function, name)

    def words(function: Any) -> str:
        _finish(function, context)
        return str(function.__dict__["__doc__"])

    return type("Late", (context.Function,), {"__getattr__": missing, "__doc__": property(words)})


def _finish(function: Any, context: Any) -> None:
    """Make a function, unless another thread has meanwhile."""
    with _lock:
        state = vars(function)
        if "_calls" in state:
            made = _made(context, state["key"], state["_calls"], state["_make"])
            overloads = [function if each is made else each for each in made.overloads]
            del state["_calls"], state["_make"]
            # In one step: another thread may look at any moment, and waits above for what is not there yet.
            state.update({**vars(made), "overloads": overloads})
            function.__class__ = context.Function


def _made(context: Any, key: str, calls: Calls, make: Callable[..., None]) -> Any:
    """What Warp makes of these calls, by its own code, in a scope where nobody else finds it."""
    scope = {**vars(context), "builtin_functions": {}, "warp": types.SimpleNamespace(_src=sys.modules["warp._src"])}
    # It calls itself for each mix of types.
    code: Any = make
    scope["add_builtin"] = again = types.FunctionType(code.__code__, scope, code.__name__, code.__defaults__)
    for arguments, named in calls:
        again(key, *arguments, **named)
    return scope["builtin_functions"][key]
