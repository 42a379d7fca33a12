"""`python -m nonsac` is the command line."""

import sys

from nonsac.cli import main

if __name__ == "__main__":
    sys.exit(main())
