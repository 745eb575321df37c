"""Renders of a cluster that is struck at random moments: each image must have the bits of one process, and none hangs.

Slaves are killed, terminated and stopped, and their links cut, slowed and forgotten (strikes.py); masters are killed
and started again with --resume (masters.py); the disk is full (full_disk.py); slaves are killed before they
have joined or are ready (early.py). Four slaves and their master stay up over many renders; each begins anew, and
slaves that are lost are replaced by new processes. Scenes (one with every effect, and Sponza where WDPM_SCENES is set),
cache and map, passes, routing and copies change from render to render.

    python tests/chaos/run.py --renders kill=200,term=30,cut=20 --seed 1 -o out/chaos

A row for each render goes to rows-SEED.jsonl as it comes, and --resume goes on after them; the page is index.md.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from campaign import OTHERS, Campaign
from page import page
from strikes import KINDS
from trials import Rows


def counts(text: str) -> dict[str, int]:
    """kill=200,term=30 as a dictionary."""
    known = [*KINDS, *OTHERS]
    found = {}
    for part in text.split(","):
        name, _, count = part.partition("=")
        if name not in known or not count.isdigit():
            raise argparse.ArgumentTypeError(f"{part!r}; expected KIND=COUNT with a KIND of {', '.join(known)}")
        found[name] = int(count)
    return found


def main() -> int:
    """Run, print and write; 1 if a render failed, or an image differed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--renders", type=counts, default=counts("kill=20"), metavar="KIND=COUNT,...")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--resume", action="store_true", help="go on after the rows that are there")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/chaos"))
    args = parser.parse_args()
    rows = Rows(args.output / f"rows-{args.seed}.jsonl", resume=args.resume)
    campaign = Campaign(rows, args.seed)
    for name, count in args.renders.items():
        for trial in campaign.trials(name, count):
            rows.add(trial)
            (args.output / "index.md").write_text(page(rows.trials, args.seed))
            verdict = trial.error or "equal"
            print(
                f"{trial.kind} {trial.number}: {trial.configuration}: {', '.join(trial.happened)}: {verdict}",
                flush=True,
            )
    return int(any(trial.error for trial in rows.trials))


if __name__ == "__main__":
    sys.exit(main())
