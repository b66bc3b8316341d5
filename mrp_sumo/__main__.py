"""`python -m mrp_sumo` is the command `mrp-sumo`."""

import sys

from mrp_sumo.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
