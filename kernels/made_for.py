"""Kernels that factories make for a set of features, each in a module of its own, which no other variant changes."""

from __future__ import annotations

import threading
from collections.abc import Callable

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.lazy_parsing import look_up_no_calls
from wdpm.kernels.module_hashes import Hashes, hashes

OPTIONS = {"fuse_fp": False}
"""Of their modules: no contraction, as in every file with kernels (docs/exactness.md)."""

_made: dict[str, wp.Kernel] = {}
"""By the name of its module, which Warp makes of what the kernel does."""

_making = threading.RLock()
"""Threads may ask for a variant together, and Warp takes a second kernel of one name for a change of the first."""


def made_for(features: Features) -> Callable[[Callable[..., None]], wp.Kernel]:
    """In place of `wp.kernel`, inside a factory of kernels.

    Warp names the module of such a kernel by its hash, so that variants that do the same are one; names are remembered
    (module_hashes.py).

    Args:
        features: what the kernel is made for. Besides the sources, nothing else may tell what it does.
    """

    def make(function: Callable[..., None]) -> wp.Kernel:
        known = hashes()
        variant = f"{function.__module__}.{function.__qualname__}({','.join(features.names())})"
        with _making:
            return _kernel(function, variant, known)

    return make


def _kernel(function: Callable[..., None], variant: str, known: Hashes) -> wp.Kernel:
    name = known.variant(variant)
    if name in _made:
        return _made[name]
    if name is None:
        kernel = wp.kernel(function, module="unique", enable_backward=False, module_options=dict(OPTIONS))
        known.add_variant(variant, kernel.module.name)
    else:
        module = wp.get_module(name)
        wp.set_module_options(dict(OPTIONS), module)
        look_up_no_calls(module)
        kernel = wp.kernel(function, enable_backward=False, module=module)
    return _made.setdefault(kernel.module.name, kernel)
