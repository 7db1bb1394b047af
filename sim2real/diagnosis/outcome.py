"""What a diagnosis leaves behind: its report, its effects, and their files.

write(found, Path("outputs/diagnosis"))     # report.json, report.html, effects.yaml, model.xml
last_words(found.report)                    # what to correct first
"""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import mujoco

from envs.effects import Effect, merge_effects, write_effects
from envs.effects.file import Values
from envs.plant import Fixed
from sim2real.diagnosis.experiments.apart import Member
from sim2real.diagnosis.preflight.checks import BLOCKING, NOTES
from sim2real.diagnosis.report.html import write_html
from sim2real.diagnosis.report.model_file import write as write_model
from sim2real.diagnosis.report.text import residual_sentence, same_joint_warning
from sim2real.diagnosis.schema import Finding, Report


class Diagnosis(NamedTuple):
    """A report, and what its files are made of."""

    report: Report
    found: tuple[Fixed, ...]  # the causes with their values
    spec: mujoco.MjSpec  # of the first log's model
    intervals: tuple[tuple[float, float], ...]  # of each cause's first value
    known: tuple[Fixed, ...]  # what was in the model before
    equivalents: tuple[Member, ...] = ()  # explanations that the logs cannot tell apart
    floors: Mapping[str, float] = MappingProxyType({})  # noise of each joint [rad or m]

    @property
    def effects(self) -> list[tuple[Effect, Values]]:
        """What was in the model before and the causes, as one list."""
        return merge_effects(self.known, self.found)


def write(found: Diagnosis, out: Path) -> None:
    """Write all files of a diagnosis into a folder, the report first.

    A log that contradicts itself says nothing of the robot: with a finding of `BLOCKING` there is
    neither `effects.yaml` nor `model.xml`, nor those of an earlier diagnosis.
    """
    out.mkdir(parents=True, exist_ok=True)
    for earlier in ("effects.yaml", "model.xml"):
        (out / earlier).unlink(missing_ok=True)
    found.report.write(out / "report.json")
    write_html(out / "report.html", found.report)
    if not blocking_findings(found.report):
        write_effects(out / "effects.yaml", found.effects, intervals_of(found))
        write_model(found.spec, found.effects, out / "model.xml")


def blocking_findings(report: Report) -> list[Finding]:
    """Return the findings because of which no effects are written."""
    return [finding for finding in report.preflight if finding.check in BLOCKING]


def final_message(report: Report) -> list[str]:
    """Return what a person should read last: what to correct before the answer can be trusted."""
    words = [text for text in (residual_sentence(report), same_joint_warning(report)) if text]
    words += [f"mend the log, {c.remedy}" for c in report.causes if c.remedy]
    words += [f"{f.finding} {f.fix}" for f in report.preflight if f.check not in NOTES]
    words += [f"numerics, {name}: {text}" for name, text in report.numerics.items() if text != "ok"]
    words += [f"not in the report: {text}" for text in report.failed]
    if blocking_findings(report):
        words.append("effects.yaml and model.xml are not written: correct the log first")
    return words


def intervals_of(found: Diagnosis) -> list[tuple[float, float] | None]:
    """Return the intervals of the combined effects' first values; None for what was known alone."""
    lows, highs = (
        merge_effects(
            found.known,
            [
                (effect, (ends[side], *values[1:]))
                for (effect, values), ends in zip(found.found, found.intervals, strict=True)
            ],
        )
        for side in (0, 1)
    )
    named = {effect.label() for effect, _ in found.found}
    return [
        (low[0], high[0]) if effect.label() in named else None
        for (effect, low), (_, high) in zip(lows, highs, strict=True)
    ]
