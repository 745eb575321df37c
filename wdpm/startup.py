"""Python's garbage collector while a command starts.

Starting makes a million objects that stay: modules, functions, syntax trees of kernels. The collector would look
through them again and again, for a sixth of the time that a small render takes, and find nothing to collect.
"""

from __future__ import annotations

import gc

_held_off = False


def hold_off_collector() -> None:
    """Switch the collector off until `let_collector_go` is called. For commands: it belongs to the whole process."""
    global _held_off
    _held_off = _held_off or gc.isenabled()
    gc.disable()


def let_collector_go() -> None:
    """Switch it on again, if it was held off; what there is by then it need not look at any more."""
    global _held_off
    if _held_off:
        gc.freeze()
        gc.enable()
        _held_off = False
