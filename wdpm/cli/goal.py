"""Options that ask for an error or a time in place of settings, and what is said about what came of it."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable
from dataclasses import asdict, fields
from enum import Enum
from typing import Any

from wdpm import values
from wdpm.cli.options import SETTING_OPTIONS, chosen_settings, look_words, scene_words
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.rendering.backend import Backend
from wdpm.scenes.errors import SettingsError

EXIT_NOT_REACHED = 3
"""The image is written, but its error is larger than was asked for."""

METRICS = ("relmse", "rmse")


def add_until_options(parser: argparse.ArgumentParser) -> None:
    """--until-error, --metric and --time-budget."""
    group = parser.add_argument_group("asking for an error or a time, in place of settings (docs/accuracy.md)")
    group.add_argument(
        "--until-error",
        type=values.error_bound,
        metavar="E",
        help="pick settings, as by default or by trials, and render until the error is at most E with 90 %% confidence;"
        f" settings that are given are kept. Exit code {EXIT_NOT_REACHED} if E is not reached",
    )
    group.add_argument(
        "--metric", choices=METRICS, help="error that --until-error bounds, see wdpm compare (default: relmse)"
    )
    group.add_argument(
        "--time-budget",
        type=values.duration,
        metavar="TIME",
        help="pick settings and render so that the image is written after this time, like 90, 60s or 2m, counted from "
        "the start of wdpm",
    )


def asks_for_a_goal(args: argparse.Namespace) -> bool:
    """Whether an error or a time is asked for. Raises SettingsError for options that contradict each other."""
    if args.until_error is None and args.time_budget is None:
        if args.metric is not None:
            raise SettingsError("--metric says what an error is measured with: give --until-error, too")
        return False
    asked = "--until-error" if args.until_error is not None else "--time-budget"
    from wdpm.goal.checks import refuse_beside_goal

    refuse_beside_goal(asked, vars(args), lambda name: f"--{name.replace('_', '-')}")
    return True


def render_to_goal(args: argparse.Namespace, make_backend: Callable[[], Backend]) -> int:
    """Render and write what `args` asks for; returns the exit code.

    Args:
        make_backend: makes what renders, once the scene is loaded.
    """
    from wdpm.cli.live import shown
    from wdpm.cli.result import render_and_write
    from wdpm.goal.clock import process_age
    from wdpm.goal.goal import goal_of
    from wdpm.goal.render import OUTCOME, Abandoned, Interrupted, render_until

    goal = goal_of(args.until_error, args.metric or METRICS[0], args.time_budget)
    chosen = chosen_settings(args)
    asked: list[Any] = []
    stopped: list[BaseException | None] = []

    def render(source: Any, _settings: RenderSettings, progress: Any) -> Any:
        try:
            with make_backend() as backend:
                backend.display = view
                image = render_until(source, goal, backend, progress=progress, used=process_age(), **chosen)
        except (Interrupted, Abandoned) as stop:
            image = stop.image  # minutes of passes are worth writing, whoever got tired of them
            stopped.append(stop.__cause__)
        asked.append((image.metadata[OUTCOME], image.metadata["settings"]))
        return image

    with shown(args) as view:
        code = render_and_write(args, render, view)
    outcome, settings = asked[0]
    if not args.quiet:
        for line in outcome["lines"]:
            print(line)
        again = asked_again(chosen, settings) if settings["pass_samples"] else settings
        print(f"to repeat it to the bit: {command(args, again)}")
    elif not outcome["reached"]:
        print(f"wdpm: {outcome['lines'][-1]}", file=sys.stderr)
    for error in stopped:
        raise error or KeyboardInterrupt
    return code if outcome["reached"] else EXIT_NOT_REACHED


def asked_again(chosen: dict[str, Any], settings: dict[str, Any]) -> dict[str, Any]:
    """Settings of an image, but open what was chosen as by default: for the same samples it is chosen again.

    Args:
        chosen: settings that were given, by name.
        settings: of the image, as its metadata has them.
    """
    plain = asdict(RenderSettings(**chosen))
    plain = {name: value.value if isinstance(value, Enum) else value for name, value in plain.items()}
    return (
        settings
        | plain
        | {name: settings[name] for name in ("spp", "passes", "pass_samples", "plan_samples", "max_depth")}
    )


def command(args: argparse.Namespace, settings: dict[str, Any]) -> str:
    """The command that renders the same image with settings in place of a goal.

    Args:
        settings: of the image, as its metadata has them.
    """
    words = ["wdpm", "render", *scene_words(args)]
    defaults = {field.name: field.default for field in fields(RenderSettings)}
    given = chosen_settings(args)
    ignored = RenderSettings(integrator=Integrator(settings["integrator"])).algorithm.ignored
    for option in SETTING_OPTIONS:
        value, default = settings[option.field], defaults[option.field]
        default = default.value if isinstance(default, Enum) else default
        of_no_effect = value == default or option.field in ignored
        if of_no_effect and option.field not in given and option.field not in ("spp", "max_depth"):
            continue
        flag = "--" + option.field.replace("_", "-")
        if option.parse is None:
            words += [flag] if value else []
        elif isinstance(value, list | tuple):
            words += [flag, ",".join(map(str, value))] if value else []
        elif value is not None:
            words += [flag, str(value)]
    return shlex.join(words + look_words(args))
