"""Golden files: what the program answers today, and whether it still does after a reorganisation.

    python -m benchmarks.golden record                                   # half an hour; resumes
    python -m benchmarks.golden record --only esmaml,deploy              # a minute
    python -m benchmarks.golden record --tree ../before --out outputs/before   # another checkout
    python -m benchmarks.golden compare                                  # with what is committed
    python -m benchmarks.golden compare --new outputs/golden --with outputs/before

`record` runs the command line of the project (nothing of it is imported, so that its modules may
move) and writes one JSON file a part: figures, hashes, command lines, versions. Runs are kept below
`OUT/runs`, and repeated only where the command or the code is another one; `--fresh` repeats all.
`compare` prints what differs, and ends with status 1 where that is more than a part may.

| part | what | must |
|---|---|---|
| `esmaml` | three iterations of the main job, and a small evaluation | be identical |
| `deploy` | quad8 on the emulated bus after three iterations | be identical |
| `nav2d` | thirty iterations, and the evaluation of all goals | be identical |
| `ppo` | 50,000 steps, 20 seeds | be identical, or train to the same mean return within 15 % |
| `ppo_sb3`, `sac` | 50,000 and 10,000 steps, 5 seeds each | be printed |

Bits are those of one machine and one set of packages: on another, record the old code anew with
`--tree`. Records of diagnoses, of an engine that no longer exists, are at `studies-1`; what a
diagnosis answers is held by the exams.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.golden_compare import compared, judged, markdown
from benchmarks.golden_parts import PARTS, Job, sha256

ROOT = Path(__file__).resolve().parent.parent
RESULTS = Path(__file__).parent / "results" / "golden"
OUT = Path("outputs/golden")
DONE = "golden.json"  # in the folder of a run that came to its end: what ran, its CPU seconds
CODE = ("conf", "envs", "hardware", "sim2real")  # folders of a checkout that answers depend on
THREADS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
KEPT = ("revision", "dirty", "python", "packages", "cpu", "system")  # of a run's manifest


class Recorder(NamedTuple):
    """Where to run and what to keep.

    Args:
        tree: the checkout whose code is run.
        code: hash of that code.
        out: folder of the records; runs go below it.
        fresh: whether runs that are there are repeated.
    """

    tree: Path
    code: str
    out: Path
    fresh: bool

    @property
    def runs(self) -> Path:
        """Folder of the runs."""
        return self.out / "runs"

    def record(self, part: str) -> Path:
        """Run the jobs of a part and write its record; return the file."""
        jobs = PARTS[part].jobs()
        found = {job.name: self.recorded(job) for job in jobs}
        made = {"code": self.code, **manifest(self.runs / jobs[0].name)}
        file = self.out / f"{part}.json"
        write(file, json.dumps({"part": part, "made": made, "jobs": found}, indent=1) + "\n")
        return file

    def recorded(self, job: Job) -> dict[str, Any]:
        """Run a job and return its command line, its CPU seconds and its figures."""
        seconds = self.run(job)
        command = " ".join(["python -m sim2real", *job.arguments])
        figures = job.figures(self.runs / job.name)
        return {"command": command, "cpu_seconds": round(seconds, 1), "figures": figures}

    def run(self, job: Job) -> float:
        """Run a job unless this code has run it; return the CPU seconds that it took [s].

        Raises:
            SystemExit: it failed.
        """
        folder = self.runs / job.name
        done, wanted = folder / DONE, {"arguments": list(job.arguments), "code": self.code}
        said = json.loads(done.read_text(encoding="utf-8")) if done.is_file() else {}
        if wanted.items() <= said.items() and not self.fresh:
            return said["cpu_seconds"]
        shutil.rmtree(folder, ignore_errors=True)
        print(f"{job.name}: {' '.join(job.arguments)}", file=sys.stderr, flush=True)
        seconds = self.call([*job.arguments, f"hydra.run.dir={folder}"])
        write(done, json.dumps({**wanted, "cpu_seconds": seconds}))
        return seconds

    def call(self, arguments: Sequence[str]) -> float:
        """Run the command line in the tree; return the CPU seconds [s].

        Raises:
            SystemExit: it failed.
        """
        filled = [argument.format(RUNS=self.runs) for argument in arguments]
        command = [sys.executable, "-m", "sim2real", *filled]
        environment = {**os.environ, **THREADS, "PYTHONPATH": str(self.tree)}
        process = subprocess.Popen(command, cwd=self.tree, env=environment)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            sys.exit(f"{' '.join(command)} ended with status {process.returncode}")
        return usage.ru_utime + usage.ru_stime


def fingerprint(tree: Path) -> str:
    """Return a hash of all files of a checkout that answers depend on, committed or not."""
    listing = ["git", "-C", str(tree), "ls-files", "-z", "--cached", "--others"]
    listed = subprocess.run(
        [*listing, "--exclude-standard", "--", *CODE], capture_output=True, text=True, check=True
    )
    files = sorted({name for name in listed.stdout.split("\0") if (tree / name).is_file()})
    found = hashlib.sha256()
    for name in files:
        found.update(f"{name}\0{sha256((tree / name).read_bytes())}\n".encode())
    return found.hexdigest()


def manifest(run: Path) -> dict[str, Any]:
    """Return what a run says of the code, the packages and the machine that made it."""
    said = json.loads((run / "manifest.json").read_text(encoding="utf-8"))
    flat = {**said, **said["git"], **said["machine"]}
    return {name: flat[name] for name in KEPT if name in flat}


def write(file: Path, text: str) -> None:
    """Write a file whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_name(f"{file.name}.part")
    part.write_text(text, encoding="utf-8")
    part.replace(file)


def compare(new: Path, old: Path, parts: Sequence[str], every: bool) -> int:
    """Print what differs between two folders of records; return the exit status."""
    status = 0
    for part in parts:
        files = [folder / f"{part}.json" for folder in (old, new)]
        missing = [str(file) for file in files if not file.is_file()]
        if missing:
            print(f"## {part}\n\nno {' and no '.join(missing)}\n")
            status = 1
            continue
        before, after = (json.loads(f.read_text(encoding="utf-8"))["jobs"] for f in files)
        rows = compared(before, after)
        verdict = judged(PARTS[part].rule, PARTS[part].figures, before, after, rows)
        status |= not verdict.passed
        print(f"## {part}\n\n{markdown(rows, every)}\n{verdict.sentence}\n")
    return status


def chosen_parts(text: str, parser: argparse.ArgumentParser) -> list[str]:
    """Return the parts named with commas between; all for an empty text."""
    names = [name for name in text.split(",") if name] or list(PARTS)
    unknown = [name for name in names if name not in PARTS]
    if unknown:
        parser.error(f"no part {unknown[0]!r}; there are: {', '.join(PARTS)}")
    return names


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.golden",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True)
    recording = commands.add_parser("record", help="run the program and write the records")
    comparing = commands.add_parser("compare", help="print what differs between two records")
    for command in (recording, comparing):
        command.add_argument("--only", default="", help="parts with commas between; default: all")
    add = recording.add_argument
    add("--out", type=Path, default=OUT, help="folder of records and runs (default: %(default)s)")
    add("--tree", type=Path, default=ROOT, help="checkout whose code is run; default: this one")
    add("--fresh", action="store_true", help="repeat runs that are there")
    add = comparing.add_argument
    add("--new", type=Path, default=OUT, help="folder of the new records (default: %(default)s)")
    add("--with", type=Path, default=RESULTS, dest="old", help="folder; default: the committed one")
    add("--every", action="store_true", help="print every figure that differs")
    chosen = parser.parse_args(arguments)
    parts = chosen_parts(chosen.only, parser)
    if chosen.command == "compare":
        return compare(chosen.new, chosen.old, parts, chosen.every)
    tree, out = chosen.tree.resolve(), chosen.out.resolve()
    recorder = Recorder(tree, fingerprint(tree), out, chosen.fresh)
    for part in parts:
        print(recorder.record(part))
    return 0


if __name__ == "__main__":
    sys.exit(main())
