"""What the benchmarks on real logs share: their command line, and how a diagnosis is summed up.

chosen = arguments("so101", __doc__, "so101", None)     # None, and a word why, without the logs
before, after = gap(answer)                             # of a report.json
values(answer)                                          # its causes, or what is only fitted
"""

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.study import command


def arguments(
    name: str, doc: str | None, folder: str, words: Sequence[str] | None
) -> argparse.Namespace | None:
    """Read a benchmark's command line: data, report, out and results.

    Args:
        name: the module's.
        doc: what `--help` says.
        folder: the one that it needs below SIM2REAL_DATA.
        words: of the command line; None for the program's own.

    Returns:
        The choices, or None where the logs are missing, which is said.
    """
    parser = command(name, doc, "out", "results")
    add, data = parser.add_argument, os.environ.get("SIM2REAL_DATA")
    add("--data", type=Path, default=data and Path(data), help="default: SIM2REAL_DATA")
    add("--report", action="store_true", help="diagnose nothing, write the tables")
    chosen = parser.parse_args(words)
    if chosen.data is None or not (chosen.data / folder).is_dir():
        print(
            f"skipped: SIM2REAL_DATA has no {folder}/ (docs/explanation/evidence.md)",
            file=sys.stderr,
        )
        return None
    return chosen


def gap(answer: Mapping[str, Any]) -> tuple[float, float]:
    """Return a report's gap before and after; the same where nothing was found."""
    found = answer["gap"]
    return found["before"], found["before"] if found["after"] is None else found["after"]


def values(answer: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    """Return the effects with a value: the causes, or what a verdict of `fitted` has instead."""
    return answer["causes"] or answer.get("fitted", ())
