"""Which slave a batch is for."""

from __future__ import annotations

from wdpm.cluster.batch import OF_MAPS, TO_HOME, Batch
from wdpm.cluster.messages.protocol import Setup
from wdpm.scenes.errors import ProtocolError


def destination_of(batch: Batch, setup: Setup | None, source: str) -> int:
    """The slave that a batch is for.

    Args:
        setup: says who holds what; None if there is none yet.
        source: who sends it, for the error.

    Raises:
        ProtocolError: it names a cell, or a home, that nobody is.
    """
    holders = () if setup is None else setup.holders
    slaves = 0 if setup is None else len(setup.peers)
    homes = batch.runs.home
    if batch.kind in OF_MAPS:
        known = True
    elif len(homes) == 1:
        known = 0 <= homes.item(0) < slaves
    else:
        known = homes.min() >= 0 and homes.max() < slaves
    if not (0 <= batch.cell < len(holders) and known):
        named = ", ".join(str(home) for home in sorted(set(homes.tolist())))
        raise ProtocolError(
            f"a {batch.kind.value} batch of {source} is for cell {batch.cell} and home {named}; "
            f"there are {len(holders)} cells and {slaves} slaves"
        )
    return batch.home if batch.kind in TO_HOME else holders[batch.cell]
