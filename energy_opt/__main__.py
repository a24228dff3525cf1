"""`energy-opt` and `python -m energy_opt`. Ctrl-C ends the program without a traceback, also while libraries load."""

import os
import signal
import sys


def command() -> int:
    """Run the command; returns the exit code."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # sums, and so results, do not depend on the number of cores
    heeded = signal.getsignal(signal.SIGINT) is not signal.SIG_IGN
    if heeded:
        signal.signal(signal.SIGINT, lambda *_: os._exit(130))  # no work can be lost yet
    from energy_opt.cli.faults import interrupt
    from energy_opt.cli.main import main

    if heeded:
        signal.signal(signal.SIGINT, interrupt)
    try:
        return main()
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # all files are written


if __name__ == "__main__":
    sys.exit(command())
