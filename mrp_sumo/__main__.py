"""`python -P -m mrp_sumo` is the command `mrp-sumo`. Without `-P`, Python itself imports from the current folder before we are asked."""

import sys

from mrp_sumo.cli.start import main

if __name__ == "__main__":
    sys.exit(main())
