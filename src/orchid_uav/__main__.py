"""The ``orchid`` command, also as ``python -m orchid_uav``."""

import gc
import os
import sys
from contextlib import suppress


def main() -> int:
    """Run the command. Ctrl-C during its imports, which take a while, shows no traceback either."""
    _occupy_descriptors()
    try:
        from orchid_uav.cli.main import main as command
        from orchid_uav.experiments.interruption import ignore_signals

        code = command()
        ignore_signals()
        gc.freeze()  # or Python looks through torch and numba once more, for a second or two
        return code
    except KeyboardInterrupt:
        with suppress(OSError):
            print("interrupted", file=sys.stderr)
        return 130


def _occupy_descriptors() -> None:
    """Open the null device as 0 to 2 where these are closed, so that no file gets their numbers.

    What is printed, by libraries in C as well, would be written into it.
    """
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # the lowest that is free
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, closefd=False))  # noqa: SIM115


if __name__ == "__main__":
    sys.exit(main())
