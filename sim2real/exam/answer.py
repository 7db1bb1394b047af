"""One diagnosis of an exam, in a separate process that receives a case's logs and nothing else.

    python -m sim2real.exam.answer outputs/exam/logs/case_007 outputs/exam/answers/case_007

`task.json` among the logs says which effects may not be used, which file has effects that are known
already, and the seed. The answer is `report.json` and `effects.yaml`, what a user of the diagnosis
gets; as there they are written with the verdict, and again once the rest is added, so that a case
whose time is over in between has its answer. A diagnosis that fails leaves `error.txt`, which
counts as wrong. `version.txt` names which code answered, so that an exam of several versions is
known for one.
"""

import hashlib
import json
import os
import subprocess
import sys
import traceback
from pathlib import Path

from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text

REPORT, EFFECTS, ERROR, TASK = "report.json", "effects.yaml", "error.txt", "task.json"
VERSION = "version.txt"  # of the code that answered


def answered(folder: Path) -> bool:
    """Return whether a case has its answer, be it a failure."""
    return (folder / REPORT).is_file() or (folder / ERROR).is_file()


def ask(logs: Path, answer: Path, longest: float) -> None:
    """Start a process that diagnoses the case of a folder, and wait for its answer.

    After `longest` [s] it counts as failed.
    """
    answer.mkdir(parents=True, exist_ok=True)
    write_text(answer / VERSION, f"{version()}\n")
    command = [sys.executable, "-m", "sim2real.exam.answer", str(logs), str(answer)]
    root = Path(__file__).parents[2]
    paths = os.pathsep.join([str(root), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": paths}
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=longest, env=environment, check=False
        )
        said = done.stderr[-4000:]
    except subprocess.TimeoutExpired:
        said = f"no answer within {longest:g} s"
    if not answered(answer):
        write_text(answer / ERROR, said or "the process ended without a word")


def version() -> str:
    """Return a hash of all code that a diagnosis is made of."""
    root = Path(__file__).parents[2]
    places = (root / "sim2real" / "diagnosis", root / "envs")
    files = sorted(file for place in places for file in place.rglob("*.py"))
    text = b"".join(file.read_bytes() for file in files)
    return hashlib.sha256(text).hexdigest()[:12]


def answer(logs: Path, folder: Path) -> None:
    """Diagnose one case in this process and write the answer, or what went wrong."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        _diagnose(logs, folder)
    except Exception:
        write_text(folder / ERROR, traceback.format_exc())


def _diagnose(logs: Path, folder: Path) -> None:
    from envs.effects import write_effects
    from hardware.log import read_logs
    from sim2real.diagnosis.diagnose import run_diagnosis
    from sim2real.diagnosis.outcome import Diagnosis

    def write(found: Diagnosis) -> None:
        write_effects(folder / EFFECTS, found.found)
        found.report.write(folder / REPORT)

    task = json.loads((logs / TASK).read_text(encoding="utf-8"))
    known = logs / task["effects"] if task["effects"] else None
    given = read_logs(logs), None, known, tuple(task["exclude"]), task["seed"], None
    write(run_diagnosis(*given, on_verdict=write))


def main(arguments: list[str]) -> None:
    """Answer the case of the command line.

    Raises:
        Sim2RealError: not two folders.
    """
    if len(arguments) != 2:
        raise Sim2RealError("two folders are needed: a case's logs, and where its answer goes")
    answer(Path(arguments[0]), Path(arguments[1]))


if __name__ == "__main__":
    main(sys.argv[1:])
