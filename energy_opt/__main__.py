"""`energy-opt` and `python -m energy_opt`. Ctrl-C ends the program without a traceback, also while libraries load.

SIGTERM, with which containers and batch systems end a program, counts as Ctrl-C.
"""

import os
import signal
import sys


def leave(signum: int, frame: object) -> None:
    """End the program at Ctrl-C while it loads; with --json, as always, with a document."""
    if "--json" in sys.argv:
        os.write(1, b'{"status": "interrupted", "message": "interrupted"}\n')
    os._exit(130)


def command() -> int:
    """Run the command; returns the exit code."""
    own = os.getpid()

    def terminate(signum: int, frame: object) -> None:
        """Handle SIGTERM as Ctrl-C; a forked process ends at once."""
        if os.getpid() != own:
            os._exit(143)
        signal.raise_signal(signal.SIGINT)

    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # sums, and so results, do not depend on the number of cores
    heeded = signal.getsignal(signal.SIGINT) is not signal.SIG_IGN
    if heeded:
        signal.signal(signal.SIGINT, leave)  # no work can be lost yet
        signal.signal(signal.SIGTERM, terminate)
    from energy_opt.cli.faults import interrupt
    from energy_opt.cli.main import main

    if heeded:
        signal.signal(signal.SIGINT, interrupt)
    try:
        return main()
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # all files are written
        # Python ends by the signal, not by the exit code, if Ctrl-C went through code that a library ran from text, as
        # some do while they are imported; running text forgets that.
        exec("")


if __name__ == "__main__":
    sys.exit(command())
