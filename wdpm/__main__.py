"""`python -m wdpm` is the command line, and so is the script `wdpm`."""

from typing import NoReturn

from wdpm.process_exit import leave
from wdpm.startup import hold_off_collector


def run() -> NoReturn:
    """Run the command that this process was started for, and end with its exit code."""
    hold_off_collector()  # until the command has begun

    from wdpm.cli.main import main

    leave(main())


if __name__ == "__main__":
    run()
