"""What is found wrong with a goal (an error or a time in place of settings) before anything is rendered.

For the command line and for `wdpm.render`, which spell the names of options each in their own way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from numbers import Real
from typing import Any

from wdpm.goal.goal import Goal, goal_of
from wdpm.scenes.errors import SettingsError

DEFAULT_METRIC = "relmse"

_CHOOSES = "chooses passes and samples itself"
_IN_ONE_GO = "renders one image in one go, and keeps no passes"
_OWN_RECORDS = "renders several passes, each with irradiance records of its own"

NOT_BESIDE: Mapping[str, str] = {
    "settings": "chooses settings itself, all but those that are given by name",
    "passes": _CHOOSES,
    "spp": _CHOOSES,
    "pass_samples": _CHOOSES,
    "journal": _IN_ONE_GO,
    "resume": _IN_ONE_GO,
    "keep": _IN_ONE_GO,
    "keep_passes": _IN_ONE_GO,
    "save_cache": _OWN_RECORDS,
    "load_cache": _OWN_RECORDS,
    "replay": "chooses settings while it renders, and a replay has to know them",
    # Passes of trials may become part of the image, so they cannot simply be rendered without it.
    "strict": "tries settings out, and a guard that acts on some that are not chosen would end the render: "
    "be strict in a render with the settings that it chose",
}
"""Options and arguments that make no sense beside a goal, and what the goal does that is against them."""


def refuse_beside_goal(goal: str, given: Mapping[str, Any], spelled: Callable[[str], str] = str) -> None:
    """Raise SettingsError if something was given that makes no sense beside a goal.

    Args:
        goal: name of what asks for it, such as "until_error".
        given: values by name; those that are false were not given.
        spelled: how a person writes a name.
    """
    for name, against in NOT_BESIDE.items():
        if given.get(name):
            raise SettingsError(f"{goal} {against}; leave {spelled(name)} out")


def goal_in_python(
    until_error: float | None, metric: str | None, time_budget: float | None, given: Mapping[str, Any]
) -> Goal | None:
    """The goal that arguments of `wdpm.render` stand for; None without one.

    Args:
        given: the other arguments.

    Raises:
        SettingsError: an argument is no number or out of range, or contradicts another.
    """
    if until_error is None and time_budget is None:
        if metric is not None:
            raise SettingsError("metric says what an error is measured with: give until_error, too, or leave it out")
        return None
    refuse_beside_goal("time_budget" if until_error is None else "until_error", given)
    error = _number("until_error", until_error, "a number, like 0.02")
    seconds = _number("time_budget", time_budget, "a number of seconds, like 60")
    return goal_of(error, DEFAULT_METRIC if metric is None else metric, seconds)


def _number(name: str, value: Any, expected: str) -> float | None:
    if value is None:
        return None
    if not isinstance(value, Real) or isinstance(value, bool):
        raise SettingsError(f"{name} is {value!r}; expected {expected}")
    return float(value)
