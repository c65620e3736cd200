"""The ``orchid`` command, also as ``python -m orchid_uav``."""

import sys


def main() -> int:
    """Run the command; its imports take a while, in which ctrl-C shall be no traceback either."""
    try:
        from orchid_uav.cli.main import main as command

        return command()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
