"""Objects that a program hands over: whether they are what a render will ask them for, before it begins."""

from __future__ import annotations

from typing import Generic, Protocol

from wdpm.scenes.errors import SettingsError


def check_follows(name: str, given: object, protocol: type) -> None:
    """Raise SettingsError unless an object has all that a protocol names; None stands for nobody.

    Args:
        name: of the argument.
        given: as somebody gave it.
    """
    bases = [base for base in protocol.__mro__ if base not in (object, Protocol, Generic)]
    wanted = {each for base in bases for each in vars(base) if not each.startswith("_")}
    lacking = sorted(each for each in wanted if not hasattr(given, each))
    if given is None or not (lacking or isinstance(given, type)):
        return
    why = f"it has no {', '.join(lacking)}" if lacking else "this is the class, not one of its objects"
    raise SettingsError(
        f"{name} is {given!r:.80}; expected an object as {protocol.__module__}.{protocol.__name__} says: {why}"
    )
