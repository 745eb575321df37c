"""`python -m wdpm` is the command line."""

import sys

from wdpm.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
