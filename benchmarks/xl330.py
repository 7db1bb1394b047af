"""What is missing in the data sheet's model of a real servo? A Dynamixel XL330's logs, diagnosed.

    SIM2REAL_DATA=/data python -m benchmarks.xl330
    SIM2REAL_DATA=/data python -m benchmarks.xl330 --report      # only the tables, of what there is

A pendulum of 0.49 kg was driven with P gains of 100, 200 and 800. Its models say what the manual
says: a gain whose divisor is 128, and no friction. All three gains are diagnosed together; then
each is left out, and what was found from the other two is replayed against it: whole logs, from
their first positions. The PWM that the servo reported is fitted by no diagnosis. It tells the
divisor, and so checks one of the values; that the gain is not the model's, a diagnosis knows from
it, and names the gain where other effects follow the motion as well.

docs/explanation/evidence.md names the logs, which are not part of this project. Each diagnosis has
a folder; what is there is not repeated.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks import real_logs
from benchmarks.cases import over_runs
from envs.effects import load_effects
from hardware.log import Log, read_logs
from sim2real.diagnosis.data.recording import load_model
from sim2real.diagnosis.data.replay import measure
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

GAINS = (100, 200, 800)  # the servo's P gain register
FOLDER, COUNTS, FULL = "xl330_bench", 4096, 885  # counts a turn; PWM that is all of the supply
MANUAL = 128  # PWM is P x error / this, says the manual


def gain_of(log: Log) -> int:
    """Return the P gain that a log was recorded with."""
    return int(log.meta["settings"]["hinge"]["position_p_gain"])


def name_of(log: Log) -> str:
    """Return the name of a log's file, without its ending."""
    return log.path.stem if log.path else "log"


def error(log: Log, effects: Path | None = None) -> float:
    """Return the mean absolute error of a whole log, replayed with effects [rad]."""
    found = [] if effects is None else load_effects(effects)
    return measure(log, load_model(log, None), found).errors()["hinge"]["mae"]


def share_of_gain(log: Log) -> float:
    """Return how much of the manual's P gain a servo had, by the PWM that it reported.

    The slope of PWM over P x error, where torque was on and PWM below its limit, times 128.
    """
    count = COUNTS / (2 * np.pi) * (log.column("ctrl.hinge") - log.column("qpos.hinge"))
    pwm, on = log.column("sensor.pwm"), log.column("torque.hinge") > 0
    free = on & (np.abs(pwm) < 0.95 * FULL) & (np.abs(pwm) > 0)
    asked = gain_of(log) * count[free]
    return float(MANUAL * asked @ pwm[free] / (asked @ asked))


def report(logs: Sequence[Log], out: Path, results: Path) -> Table:
    """Write xl330.md and xl330.csv and return the table of gains that were left out."""
    nominal = {name_of(log): error(log) for log in logs}
    table = Table(("left out", "as given (mrad)", "from the other gains (mrad)", "logs"))
    files = Table(("log", "as given (mrad)", "its gain left out (mrad)", "all gains fitted (mrad)"))
    for gain in GAINS:
        held = [log for log in logs if gain_of(log) == gain]
        before = [1e3 * nominal[name_of(log)] for log in held]
        after = [1e3 * error(log, out / f"without_{gain}" / "effects.yaml") for log in held]
        table.add(f"P gain {gain}", over_runs(before), over_runs(after), len(held))
        for log, first, last in zip(held, before, after, strict=True):
            every = 1e3 * error(log, out / "all" / "effects.yaml")
            files.add(name_of(log), first, last, every)
    table.notes.append(
        "Mean absolute error of whole logs, which nothing was fitted to; 95 %, bootstrap over logs."
    )
    pwm = [share_of_gain(log) for log in logs]
    text = [
        "# XL330: a real servo, diagnosed\n",
        *(_causes(out, name, words).markdown() for name, words in _fits()),
        f"The PWM that the servo reported says {np.mean(pwm):.3f} of the manual's gain "
        f"({min(pwm):.3f} to {max(pwm):.3f} in {len(pwm)} logs); no value was fitted to it.\n",
        "## Each gain left out\n",
        table.markdown(),
        files.markdown(),
    ]
    write_text(results / "xl330.md", "\n".join(text))
    write_text(results / "xl330.csv", files.csv())
    return table


def _fits() -> list[tuple[str, str]]:
    """Return folders and titles of the diagnoses."""
    return [("all", "all gains together"), *((f"without_{g}", f"without {g}") for g in GAINS)]


def _causes(out: Path, name: str, words: str) -> Table:
    """Return what one diagnosis found."""
    answer, table = real_logs.causes(out / name, words)
    before, after = real_logs.gap(answer)
    table.notes.append(
        f"{answer['verdict']}: {1e3 * before:.0f} to {1e3 * after:.0f} mrad (rms) on "
        f"held-out windows of these gains. Left: {answer['unexplained']['structure']}."
    )
    return table


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and run; return the exit status."""
    chosen = real_logs.arguments("xl330", __doc__, FOLDER, arguments)
    if chosen is None:
        return 0
    logs = [log for log in read_logs(chosen.data / FOLDER) if gain_of(log) in GAINS]
    for name, _ in () if chosen.report else _fits():
        some = [log for log in logs if name != f"without_{gain_of(log)}"]
        real_logs.diagnose(some, chosen.out / name)
    print(report(logs, chosen.out, chosen.results).markdown())
    return 0


if __name__ == "__main__":
    sys.exit(main())
