"""The verb `diagnose`: which unmodelled effect separates a robot's logs from its simulation."""

import logging
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from hardware.log import read_logs
from sim2real.diagnosis.closed_loop.check import Player
from sim2real.diagnosis.contract.logged import Policy
from sim2real.diagnosis.data.progress import ProgressLines
from sim2real.diagnosis.diagnose import run_diagnosis
from sim2real.diagnosis.outcome import Diagnosis, final_message, write
from sim2real.diagnosis.report.comparison import read_report
from sim2real.diagnosis.report.terminal import format_verdict
from sim2real.diagnosis.report.text import format_effect, place_of
from sim2real.diagnosis.schema import Report
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.manifest import command_line
from sim2real.runs.terminal import has_colours

log_ = logging.getLogger(__name__)


def run(
    *,
    log: str | list[str] | None,
    model: str | None,
    effects: str | None,
    exclude: Sequence[str],
    against: str | None,
    actor: str | None,
    seed: int,
    out: Path,
) -> Report:
    """Diagnose logs and write what was found.

    Args:
        log: a log, a folder of logs, or a list of these.
        model: an MJCF for all logs; None: the model that each log names.
        effects: an effects.yaml of what is known already; put into the model first.
        exclude: names of effects that are left out of the candidates.
        against: an earlier diagnosis, its folder or report.json; comparison.html compares both.
            None for none.
        actor: the policy that wrote the log: a run, a checkpoint, or an export; None for the one
            that the log names, if any. It plays in the corrected simulator.
        seed: the seed of the bootstrap.
        out: the run's folder; gets report.json, report.html, effects.yaml and model.xml, each whole
            or absent.

    Returns:
        The report.

    Raises:
        Sim2RealError: see `diagnose`; no log.
    """
    if not log:
        raise Sim2RealError("diagnose needs a recording; give log=PATH")
    earlier = None if against is None else read_report(against)

    def write_all(found: Diagnosis) -> None:
        report = _with_command(found.report, Path(out))
        write(found._replace(report=report), Path(out))
        if earlier is not None:
            report.save_comparison(Path(out) / "comparison.html", earlier)

    def load_policy(path: str | Path) -> Policy:
        from sim2real.deployment.actors import load_actor  # here: it needs torch

        return load_actor(path)

    def load_player(path: str | Path, task: str | None) -> Player:
        from sim2real.loops import player  # here: it needs torch

        return player.load_player(path, task)

    found = run_diagnosis(
        read_logs(log),
        model,
        effects,
        exclude,
        seed,
        ProgressLines(),
        on_verdict=write_all,
        load_policy=load_policy,
        load_player=load_player,
        actor=actor,
    )
    write_all(found)
    gap = found.report.gap
    names = ", ".join(format_effect(*place_of(cause)) for cause in found.report.values)
    log_.info("%s: %s; gap %.4g %s", found.report.verdict, names or "-", gap.before, gap.unit)
    sys.stdout.write(f"\n{format_verdict(found.report, has_colours(sys.stdout))}\n")
    for words in final_message(found.report):
        log_.warning("%s", words)
    return found.report


def _with_command(report: Report, out: Path) -> Report:
    """Return the report with the command that was given, if one started the run in this folder."""
    command = command_line(out)
    if command is None:
        return report
    inputs = {**report.evidence.inputs, "command": command}
    return replace(report, evidence=replace(report.evidence, inputs=inputs))
