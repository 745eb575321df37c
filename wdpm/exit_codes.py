"""Exit codes of all commands, for schedulers and service managers to act on: the table is in docs/deploy.md.

0 is done, and `wdpm compare --equal` and `wdpm check` have a meaning of their own for 1.
"""

from __future__ import annotations

from wdpm.scenes.errors import ClusterError, MasterLostError, WdpmError

EXIT_CLUSTER_FAILED = 1
"""A slave, the master or the network failed, or, of a slave, its master has ended without an image."""

EXIT_BAD_INPUT = 2
"""Options, a scene, keys, a place to write to, too little memory here: another try would end the same way."""

EXIT_TRY_AGAIN = 75
"""A slave that has lost its master: nothing is wrong with it. EX_TEMPFAIL of BSD's sysexits.h."""

EXIT_INTERRUPTED = 130
"""128 + SIGINT, as shells have it."""

EXIT_HUNG_UP = 129
"""128 + SIGHUP."""

EXIT_TERMINATED = 143
"""128 + SIGTERM."""


def exit_code_of(error: WdpmError) -> int:
    """The exit code of a command that an error has ended."""
    if isinstance(error, MasterLostError):
        return EXIT_TRY_AGAIN
    return EXIT_CLUSTER_FAILED if isinstance(error, ClusterError) else EXIT_BAD_INPUT
