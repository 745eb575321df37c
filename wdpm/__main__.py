"""`python -m wdpm` is the command line, and so is the script `wdpm`."""

from typing import NoReturn

from wdpm.cli.main import main
from wdpm.leaving import leave


def run() -> NoReturn:
    """Run the command that this process was started for, and end with its exit code."""
    leave(main())


if __name__ == "__main__":
    run()
