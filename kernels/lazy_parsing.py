"""Functions of kernels that Warp parses when it needs their code, not when Python reads their files.

To define a function Warp reads its source, makes a syntax tree of it and looks up all that it calls: 0.5 ms each, a
quarter of a second for those of all kernels. That is for the compiler, and for hashes: a process that finds its kernels
compiled and their hashes remembered needs none of it.

So Warp's own constructor is put off, for functions of wdpm.kernels: what it makes is made when somebody looks at
something that is not there yet. Functions of others are made as ever.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Any

import warp as wp

from wdpm.kernels.warp_versions import is_tried

OF = "wdpm.kernels."
"""Functions of the modules whose names begin so are put off."""

PLAIN = frozenset({"func", "key", "namespace", "module", "value_func", "scope_locals", "doc", "inline_hint"})
"""What Warp's constructor is given of an ordinary function. Snippets of C++ and the like are made at once."""

AT_ONCE = ("func", "key", "namespace", "module")
"""What others ask a function for that is only mentioned."""

_lock = threading.RLock()
_make: Callable[..., None] = wp.Function.__init__
_make_kernel: Callable[..., None] = wp.Kernel.__init__


class _Late(wp.Function):
    """A function that Warp has not made yet."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # Python asks everything for these
            raise AttributeError(name)
        _finish(self)
        return getattr(self, name)


def _finish(function: wp.Function) -> None:
    """Have Warp make a function, unless another thread has meanwhile.

    It is made beside the one that all know, which gets everything in one step: other threads may look at it now.
    """
    with _lock:
        if type(function) is not _Late:
            return
        keywords = function.__dict__["_keywords"]
        made = wp.Function.__new__(wp.Function)
        _make(made, **{**keywords, "module": None})  # the module has had the function all the time
        for overloads in (made.user_templates, made.user_overloads):
            overloads.update({types: function for types, each in overloads.items() if each is made})
        if made.adj.has_unresolved_static_expressions:
            keywords["module"].has_unresolved_static_expressions = True
        function.__dict__.update({**made.__dict__, "module": keywords["module"]})
        function.__class__ = wp.Function
        del function.__dict__["_keywords"]


def _begin(function: wp.Function, *arguments: Any, **keywords: Any) -> None:
    """In place of the constructor."""
    if arguments or not _can_wait(keywords):
        _make(function, *arguments, **keywords)
        return
    module = keywords["module"]
    look_up_no_calls(module)
    module.functions[keywords["key"]] = function
    module.mark_modified()
    function.__class__ = _Late
    function.__dict__.update({name: keywords[name] for name in AT_ONCE}, _keywords={**keywords, "scope_locals": {}})


def _begin_kernel(kernel: wp.Kernel, *arguments: Any, **keywords: Any) -> None:
    """In place of the constructor of kernels, which are made at once: a launch wants their arguments."""
    if keywords.get("module") is not None and _is_ours(keywords.get("func")):
        look_up_no_calls(keywords["module"])
    _make_kernel(kernel, *arguments, **keywords)


def _can_wait(keywords: Mapping[str, Any]) -> bool:
    """Whether a function is one of ours, and an ordinary one: another of the same name in its scope is overloaded."""
    function: Any = keywords.get("func")
    scope: Mapping[str, Any] = keywords.get("scope_locals") or {}
    if keywords.get("module") is None or not _is_ours(function) or not keywords.keys() <= PLAIN:
        return False
    return not isinstance(scope.get(function.__name__), wp.Function)


def _is_ours(function: Any) -> bool:
    return function is not None and str(function.__module__).startswith(OF)


def look_up_no_calls(module: wp.Module) -> None:
    """Keep Warp from looking up what a module's kernels call, which has these functions made.

    It wants to know whose kernels to load again when Python reads a file again, which it does to no file here.
    """
    if is_tried():
        module.defer_reference_scan = True


def parse_lazily() -> None:
    """Have the functions of kernels parsed late, from here on; may be called again."""
    if is_tried():
        wp.Function.__init__ = _begin
        wp.Kernel.__init__ = _begin_kernel
