"""What the benchmarks on real logs share: their command line, a diagnosis and its summary.

chosen = arguments("so101", __doc__, "so101", None)     # None, and a word why, without the logs
diagnose(logs, folder)
answer, table = causes(folder)                          # its report.json, and a table of it
before, after = gap(answer)
"""

import argparse
import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.study import command
from hardware.log import Log
from sim2real.diagnosis.diagnose import run_diagnosis
from sim2real.diagnosis.outcome import write
from sim2real.exam.answer import REPORT
from sim2real.runs.tables import Table


def arguments(
    name: str, doc: str | None, folder: str, words: Sequence[str] | None
) -> argparse.Namespace | None:
    """Read a benchmark's command line: data, report, out and results.

    Returns:
        The choices, or None where SIM2REAL_DATA has no such folder, which is said.
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


def diagnose(logs: Sequence[Log], out: Path, model: Path | None = None) -> None:
    """Diagnose logs and write all files of the diagnosis into a folder, unless they are there."""
    if (out / REPORT).is_file():
        return

    def tell(text: str, share: float) -> None:
        print(f"{out.name}: {100 * share:3.0f} %  {text}", file=sys.stderr, flush=True)

    write(run_diagnosis(logs, model, None, (), 0, tell), out)


def causes(folder: Path, title: str = "effect") -> tuple[dict[str, Any], Table]:
    """Return a diagnosis's report, and the table of its causes, or of what is only fitted."""
    answer: dict[str, Any] = json.loads((folder / REPORT).read_text(encoding="utf-8"))
    table = Table((title, "where", "value", "unit", "closed", "as good"))
    for cause in answer["causes"] or answer.get("fitted", ()):
        low, high = cause["value_ci"]
        value = f"{cause['value']:.3g} [{low:.2g}, {high:.2g}]"
        others = ", ".join(one["effect"] for one in cause["equivalent"]) or None
        where = cause["where"] or "robot"
        table.add(cause["effect"], where, value, cause["unit"], cause["closed"], others)
    return answer, table


def gap(answer: Mapping[str, Any]) -> tuple[float, float]:
    """Return a report's gap before and after; the same where nothing was found."""
    found = answer["gap"]
    return found["before"], found["before"] if found["after"] is None else found["after"]
