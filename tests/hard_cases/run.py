#!/usr/bin/env python
"""Runs the hard cases and writes one page that stands by itself: a row a case with picture, figures and verdict.

    python tests/hard_cases/run.py -o out/hard-cases            # all, in full
    python tests/hard_cases/run.py --small --only T-junctions   # cases whose names contain a text
    python tests/hard_cases/run.py --only watertight --rays 1e9

Exit code 0 if all cases pass but those that say why they cannot, else 1; 2 if no case has such a name.
"""

from __future__ import annotations

import argparse
import base64
import html
import importlib.util
import json
import platform
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from case import SECTIONS, Check, HardCase, Outcome, every_case, run_case
from numpy.typing import NDArray

from wdpm.bench.hard_cases import check_only
from wdpm.images.channels import encode_srgb8
from wdpm.images.files import png_bytes
from wdpm.progress import make_progress
from wdpm.quiet import quiet_warp
from wdpm.scenes.errors import SettingsError

sys.path.append(str(Path(__file__).resolve().parents[1] / "helpers" / "geometry"))  # pytest has it from pyproject.toml

PICTURE = 160
"""Least side of a picture on the page, in pixels."""

BRIGHT = 0.8
"""What the 99th percentile of a picture is shown as: cases are as bright as they like."""

SOUND = ("non-finite values", "samples blackened", "imbalance of energy", "the same bits in")
"""How the names of checks begin that every rendered image has: where they pass, they are one line together."""

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2em auto; max-width: 1300px; padding: 0 1em; color: #222; }
h2 { margin-top: 2em; } table { border-collapse: collapse; width: 100%; table-layout: fixed; }
td, th { border-top: 1px solid #ccc; padding: .5em .6em; text-align: left; vertical-align: top; }
img { image-rendering: pixelated; display: block; } .small { color: #555; font-size: 13px; }
.pass { color: #176b2c; } .fail { color: #b00020; font-weight: 600; } .limit { color: #8a5a00; }
th:nth-child(1) { width: 176px; } th:nth-child(2) { width: 20%; } th:nth-child(3) { width: 17%; }
th:nth-child(5) { width: 15%; } th:nth-child(6) { width: 75px; } th:nth-child(7) { width: 60px; }
img { max-width: 100%; } td { overflow-wrap: break-word; }
ul { margin: 0; padding-left: 1.1em; } .wrong { color: #b00020; } .known { color: #8a5a00; }
"""


def main() -> int:
    """Runs what is asked for and writes the page, and the same as JSON beside it."""
    args = _parse()
    names = [case.name for case in every_case()]
    if args.list:
        print("\n".join(names))
        return 0
    try:
        check_only(names, args.only)
    except SettingsError as error:
        print(f"run.py: error: {error}", file=sys.stderr)
        return 2
    quiet_warp()
    progress = make_progress()
    chosen = [case for case in every_case() if all(text in case.name for text in args.only)]
    outcomes: list[Outcome] = []
    left_out: list[tuple[HardCase, str]] = []
    progress.start("hard cases", len(chosen))
    try:
        for case in chosen:
            why = _why_not(case, full=not args.small)
            if why:
                left_out.append((case, why))
                progress.note(f"left out            {case.name}: {why}")
            else:
                outcome = run_case(case, full=not args.small, rays=None if args.rays is None else int(args.rays))
                outcomes.append(outcome)
                progress.note(f"{verdict(outcome):<10} {outcome.seconds:6.1f} s  {case.name}")
                for wrong in problems(outcome):
                    progress.note(f"{'':>20}{wrong}")
            progress.advance()
    finally:
        progress.finish()
    args.output.mkdir(parents=True, exist_ok=True)
    page = args.output / "index.html"
    page.write_text(page_of(outcomes, left_out, full=not args.small), encoding="utf-8")
    figures = [to_dict(outcome) for outcome in outcomes]
    (args.output / "figures.json").write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    failed = [outcome for outcome in outcomes if verdict(outcome) in ("fails", "passes now")]
    print(f"{summary(outcomes)}; {page}")
    return bool(failed)


def to_dict(outcome: Outcome) -> dict[str, Any]:
    """What a program may want to know of an outcome."""
    return {
        "name": outcome.case.name,
        "section": f"{outcome.case.section}. {SECTIONS[outcome.case.section]}",
        "verdict": verdict(outcome),
        "seconds": outcome.seconds,
        "problems": problems(outcome),
    }


def verdict(outcome: Outcome) -> str:
    """passes, fails, limit (as it says) or passes now (though it says that it cannot)."""
    if outcome.case.limit:
        return "passes now" if outcome.passed else "limit"
    return "passes" if outcome.passed else "fails"


def problems(outcome: Outcome) -> list[str]:
    """What was wrong, one line each."""
    wrong = [f"{c.what}: {c.measured}, expected {c.expected}" for c in outcome.run.checks if not c.passed]
    return ([outcome.error] if outcome.error else []) + wrong


def summary(outcomes: Sequence[Outcome]) -> str:
    """How many of which verdict, and the time."""
    verdicts = [verdict(outcome) for outcome in outcomes]
    counted = ", ".join(f"{verdicts.count(v)} {v}" for v in dict.fromkeys(sorted(verdicts)))
    return f"{len(outcomes)} cases in {sum(outcome.seconds for outcome in outcomes):,.0f} s: {counted or 'none'}"


def page_of(outcomes: Sequence[Outcome], left_out: Sequence[tuple[HardCase, str]], *, full: bool) -> str:
    """The page as HTML, pictures and all."""
    parts = [
        "<!doctype html><html lang='en'><head><meta charset='utf-8'><title>Hard cases</title>",
        f"<style>{STYLE}</style></head><body><h1>Hard cases</h1>",
        f"<p>{html.escape(summary(outcomes))}, {'in full' if full else 'at the small size'}, on "
        f"{html.escape(platform.machine())}. Every rendered case also demands finite values, an energy ledger that "
        "closes to 1e-5, and the same bits in one cell and in several.</p>",
    ]
    for number, title in SECTIONS.items():
        rows = [row_of(outcome) for outcome in outcomes if outcome.case.section == number]
        if rows:
            head = "<tr><th>picture<th>case<th>expected<th>measured<th>tolerance<th>verdict<th>time</tr>"
            parts.append(f"<h2>{number}. {html.escape(title)}</h2><table>{head}{''.join(rows)}</table>")
    if left_out:
        items = "".join(f"<li>{html.escape(case.name)}: {html.escape(why)}</li>" for case, why in left_out)
        parts.append(f"<h2>Left out</h2><ul>{items}</ul>")
    return "".join(parts) + "</body></html>\n"


def row_of(outcome: Outcome) -> str:
    """A row of the table."""
    case, run, said = outcome.case, outcome.run, verdict(outcome)
    picture = "" if run.picture is None else f"<img alt='' src='data:image/png;base64,{_png(run.picture)}'>"
    style = "known" if case.limit else "wrong"
    sound = [c for c in run.checks if c.passed and c.what.startswith(SOUND)]
    checks = "".join(_item(c, style) for c in run.checks if c not in sound)
    if sound:
        listed = "".join(_item(c, style) for c in sound)
        checks += (
            f"<li class='small'><details><summary>sound: {len(sound)} checks</summary><ul>{listed}</ul></details></li>"
        )
    notes = "".join(f"<div class='small'>{html.escape(note)}</div>" for note in [*run.notes, outcome.error] if note)
    kind = {"passes": "pass", "limit": "limit"}.get(said, "fail")
    why = f"<div class='small limit'>Limit: {html.escape(case.limit)}</div>" if case.limit else ""
    return (
        f"<tr><td>{picture}<td><b>{html.escape(case.name)}</b><div class='small'>{html.escape(case.shows)}</div>{why}"
        f"<td>{html.escape(case.expected)}<td><ul>{checks}</ul>{notes}<td>{html.escape(case.tolerance)}"
        f"<td class='{kind}'>{said}<td>{outcome.seconds:.1f} s</tr>"
    )


def _item(check: Check, style: str) -> str:
    """A check as an item of a list; `style` is that of one that did not pass."""
    return (
        f"<li{'' if check.passed else f' class={style}'}>{html.escape(check.what)}: {html.escape(check.measured)} "
        f"<span class='small'>({html.escape(check.expected)})</span></li>"
    )


def _png(pixels: NDArray[np.float32]) -> str:
    """A picture in base64: each pixel a square, exposed so that its bright parts are seen."""
    finite = np.nan_to_num(pixels, nan=0.0, posinf=0.0, neginf=0.0)
    white = float(np.quantile(finite.max(axis=2), 0.99))
    times = max(1, -(-PICTURE // max(finite.shape[:2])))
    shown = np.repeat(np.repeat(finite * (BRIGHT / white if white > 0 else 1.0), times, axis=0), times, axis=1)
    return base64.b64encode(png_bytes(encode_srgb8(shown))).decode("ascii")


def _why_not(case: HardCase, *, full: bool) -> str:
    if case.needs and importlib.util.find_spec(case.needs) is None:
        return f"{case.needs} is not installed"
    return "only in full" if case.slow and not full else ""


def _parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="at the size of `make test`")
    parser.add_argument("--only", nargs="+", default=[], metavar="TEXT", help="cases whose names contain all of these")
    parser.add_argument("--list", action="store_true", help="print the names of all cases, and do nothing else")
    parser.add_argument("--rays", type=float, help="of the watertight boxes (default: 2e7; 1e9 take some 20 minutes)")
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("out/hard-cases"), help="folder of the page (default: out/hard-cases)"
    )
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
