"""How far does a diagnosis get with models that nobody here chose?

    python -m benchmarks.zoo                        # two hours; goes on where it stopped
    python -m benchmarks.zoo --only reacher ant     # some of them
    python -m benchmarks.zoo --most 0               # the table of what is done so far

Gymnasium's models, two of Drake's, this project's, and one for each kind of joint, geom, actuator,
equality and tendon: each is moved for 8 s with dry friction in one joint, and is diagnosed by the
command that a user types. A model is refused where that ends with a sentence and exit status 2.
The place is right where the first cause is at that joint, its body or its actuator.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.study import command
from benchmarks.zoo.drive import Hidden, drive
from benchmarks.zoo.models import Model, models
from hardware.log import Log, write_log
from sim2real.exam.score import wilson
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table, format_cell

LONGEST = 7200.0  # s of one diagnosis, after which it counts as failed; 17 joints take an hour
FRICTION = "coulomb_friction"
SAYS = "sim2real: "  # before a sentence
REFUSED = 2  # exit status of a sentence


def main(arguments: Sequence[str] | None = None) -> int:
    """Diagnose what is not yet diagnosed, and write the table."""
    parser = command("zoo", __doc__, "out", "results")
    parser.add_argument("--seed", type=int, default=5, help="of motions and hidden friction")
    parser.add_argument("--only", nargs="+", default=[], help="names of models")
    parser.add_argument("--most", type=int, default=1000, help="diagnoses to make now")
    chosen = parser.parse_args(arguments)
    every = models()
    if unknown := sorted(set(chosen.only) - {model.name for model in every}):
        parser.error(f"no model {unknown[0]!r}; there are: {', '.join(m.name for m in every)}")
    wanted = [model for model in every if not chosen.only or model.name in chosen.only]
    left = [model for model in wanted if not _answer(chosen.out, model).is_file()]
    for model in left[: chosen.most]:
        print(f"{model.name}: {ask(model, chosen.out, chosen.seed)['outcome']}", flush=True)
    done = [_answer(chosen.out, model) for model in wanted if _answer(chosen.out, model).is_file()]
    made = table([json.loads(path.read_text(encoding="utf-8")) for path in done], len(wanted))
    made.notes.append(f"Seed {chosen.seed}.")
    made.write(chosen.results / "zoo")
    print(made.markdown())
    return 0


def _answer(out: Path, model: Model) -> Path:
    return out / model.name / "answer.json"


def ask(model: Model, out: Path, seed: int) -> dict[str, Any]:
    """Make a log of a model, diagnose it, and keep what came of it."""
    folder = out.resolve() / model.name
    folder.mkdir(parents=True, exist_ok=True)
    path, log = model.write(folder), folder / "log.csv"
    hidden, begun = _hide(path, log, np.random.default_rng([seed, zlib.crc32(model.name.encode())]))
    command = [sys.executable, "-m", "sim2real", "run=diagnose", f"log={log}", f"model={path}"]
    command.append(f"hydra.run.dir={folder / 'run'}")
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST)
        told = outcome(done, folder / "run" / "report.json", hidden)
    except subprocess.TimeoutExpired:
        told = {"outcome": "failed", "told": f"no answer within {LONGEST:.0f} s"}
    told |= {"told": told["told"].replace(f"{folder}/", "")} if "told" in told else {}
    found = {"model": model.name, "source": model.source, "joint": hidden.joint}
    found |= {"friction": hidden.friction, "seconds": time.monotonic() - begun, **told}
    write_text(_answer(out, model), json.dumps(found, indent=1))
    return found


def _hide(path: Path, log: Path, rng: np.random.Generator) -> tuple[Hidden, float]:
    """Write a log; of a model that MuJoCo cannot read one of nothing, so that it is refused."""
    try:
        hidden = drive(path, log, rng)
    except ValueError:
        rows = np.arange(200) / 100.0
        write_log(log, Log({"episode": 0 * rows, "time": rows, "ctrl.a": rows, "qpos.a": rows}))
        hidden = Hidden("", 0.0, ())
    return hidden, time.monotonic()


def outcome(done: subprocess.CompletedProcess[str], report: Path, hidden: Hidden) -> dict[str, Any]:
    """Return what a diagnosis came to."""
    if done.returncode == REFUSED:
        said = done.stderr[max(done.stderr.rfind(SAYS), 0) :]
        return {"outcome": "refused", "told": " ".join(said.removeprefix(SAYS).split())}
    if done.returncode:
        return {"outcome": "failed", "told": done.stderr.strip()[-400:]}
    told = json.loads(report.read_text(encoding="utf-8"))
    causes = told["causes"] or told["fitted"] or []
    first = causes[0] if causes else {"effect": None, "where": None, "value": None}
    right = first["where"] in hidden.places
    return {
        "outcome": "right" if right else "wrong" if causes else "none",
        "verdict": told["verdict"],
        "effect": first["effect"],
        "where": first["where"],
        "value": first["value"],
        "closed": told["gap"]["closed"],
    }


def table(done: list[dict[str, Any]], wanted: int) -> Table:
    """Return the table of some answers."""
    keys = ("joint", "friction", "outcome", "verdict", "effect", "where", "value", "closed")
    made = Table(["source", "model", *keys, "seconds"], [])
    for one in done:
        made.rows.append([one["source"], one["model"], *(one.get(k) for k in keys), one["seconds"]])
    refused = [one for one in done if one["outcome"] == "refused"]
    asked = [one for one in done if one["outcome"] != "refused"]
    right = [one["outcome"] == "right" for one in asked]
    friction = [one["outcome"] == "right" and one["effect"] == FRICTION for one in asked]
    made.notes.append(f"{len(done)} of {wanted} models; {len(refused)} refused.")
    for text, hits in (("The place is right", right), ("as dry friction", friction)):
        if share := wilson(hits):
            made.notes.append(
                f"{text}: {sum(hits)} of the other {len(hits)}, {format_cell(share)}."
            )
    made.notes += [f"{one['model']}: {one['told']}" for one in done if "told" in one]
    return made


if __name__ == "__main__":
    sys.exit(main())
