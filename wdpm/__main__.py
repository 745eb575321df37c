"""`python -m wdpm` is the command line, and so is the script `wdpm`."""

import os
import sys
from typing import NoReturn

from wdpm.process_exit import leave
from wdpm.startup import hold_off_collector


def have_streams() -> None:
    """Open standard input, output and errors where whoever started this process has closed them.

    Python has None in place of such a stream, and what is opened next would get its number: a socket to a slave, into
    which compiled code then writes its errors.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            descriptor = os.open(os.devnull, os.O_RDWR)
            os.set_inheritable(descriptor, True)
            setattr(sys, name, os.fdopen(descriptor, mode))


def run() -> NoReturn:
    """Run the command that this process was started for, and end with its exit code."""
    have_streams()
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
