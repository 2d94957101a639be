"""`python -m sport`: the same as the `sport` command."""

import sys

from sport.cli import main

if __name__ == "__main__":
    sys.exit(main())
