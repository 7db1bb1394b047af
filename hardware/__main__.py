"""The command line for servos: python -m hardware; `hardware.commands` says what it can do."""

from __future__ import annotations

import sys

ROOMS = ("hardware", "envs", "sim2real")


def main() -> int:
    """Run the command line; a package that this Python lacks is a sentence."""
    try:
        from hardware import commands
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] in ROOMS:
            raise
        print(
            f"{sys.executable} has no package {error.name!r}: use the Python that sim2real is "
            "installed in, such as .venv/bin/python after make setup, or install it here with: "
            "pip install .",
            file=sys.stderr,
        )
        return 1
    return commands.main(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
