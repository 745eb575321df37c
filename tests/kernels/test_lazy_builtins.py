"""Warp's own functions that are made late are those that Warp makes at once."""

from __future__ import annotations

import subprocess
import sys
import threading
from types import SimpleNamespace
from typing import Any

from wdpm.kernels import lazy_builtins

DESCRIBED = """
import re, sys
if sys.argv[1] == "late":
    import wdpm.kernels
import warp
from warp._src import context
plain = [type(function) is context.Function for function in context.builtin_functions.values()]
print("PLAIN", all(plain), plain.count(False) > 300)

def words(value):
    if isinstance(value, dict):
        return str({key: words(each) for key, each in value.items()})
    if isinstance(value, list):
        return str(len(value))
    name = getattr(value, "__qualname__", None)
    return name if name else re.sub(" at 0x[0-9a-f]*", "", repr(value))

for key, function in context.builtin_functions.items():
    if function.func is None:
        known = [function is each for each in function.overloads]
        print("IS", key, getattr(warp, key, None) is function, known, function.__doc__)
        for each in function.overloads:
            print("HAS", {name: words(value) for name, value in sorted(vars(each).items()) if name != "overloads"})
    assert type(function) is context.Function
"""


def described(how: str) -> list[str]:
    """What a process of its own says of all of Warp's functions."""
    done = subprocess.run([sys.executable, "-c", DESCRIBED, how], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def test_every_function_and_every_overload_is_the_one_that_warp_makes() -> None:
    at_once, late = described("at once"), described("late")
    assert at_once[0] == "PLAIN True False"
    assert late[0] == "PLAIN False True"
    assert len(late) > 3000
    assert late[1:] == at_once[1:]


class Function:
    """In place of Warp's class."""

    def __init__(self, key: str, types: str) -> None:
        self.key, self.types, self.overloads = key, types, [self]


def add_builtin(key: str, types: str = "", export: bool = True, again: bool = True) -> None:
    """In place of Warp's: of each function it makes one overload more than it was told of."""
    functions = globals()["builtin_functions"]
    made = Function(key, types)
    functions.setdefault(key, made)
    if functions[key] is not made:
        functions[key].overloads.append(made)
    if again:
        globals()["add_builtin"](key, f"{types} again", export, again=False)


def test_threads_that_look_together_find_one_whole_function() -> None:
    context = SimpleNamespace(Function=Function, builtin_functions={}, add_builtin=add_builtin)
    lazy_builtins._put_off(context)
    context.add_builtin("late", types="one", export=False)
    context.add_builtin("late", types="two", export=False)
    function = context.builtin_functions["late"]
    found: list[Any] = []
    together = threading.Barrier(8)

    def look() -> None:
        together.wait()
        found.append([each.types for each in function.overloads])

    threads = [threading.Thread(target=look) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [["one", "one again", "two", "two again"]] * 8
    assert type(function) is Function
    assert function.overloads[0] is function
    assert list(context.builtin_functions) == ["late"]
