"""`python -m energy_opt` is the command `energy-opt`."""

import sys

from energy_opt.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
