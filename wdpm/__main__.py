"""`python -m wdpm` is the command line, and so is the script `wdpm`."""

import sys
from typing import NoReturn

from wdpm.process_exit import leave
from wdpm.standard_streams import take_streams
from wdpm.startup import hold_off_collector


def run() -> NoReturn:
    """Run the command that this process was started for, and end with its exit code."""
    take_streams()
    hold_off_collector()  # until the command has begun
    try:
        from wdpm.cli.main import main

        code = main()
    except KeyboardInterrupt:  # so early that no command was there to take it: nothing is begun, and nothing to be told
        from wdpm.exit_codes import EXIT_INTERRUPTED

        print("wdpm: interrupted", file=sys.stderr)
        code = EXIT_INTERRUPTED
    leave(code)


if __name__ == "__main__":
    run()
