"""Deploy, diagnose, price, retrain, deploy again: until the robot does what the simulator promises.

    told = improve(site, parts, training, first, plan, out)
    told.end, told.best                         # "within_noise", 1

Round 0 deploys the policy as given. A round checks the interface of the policy on its log, records
the robot, diagnoses all recordings so far, prices what was found, trains on from where the policy
is in the corrected simulator, and deploys again. Its folder holds, in this order:

    contract.json, contract.html    the interface of the policy before
    stand/                          the recordings, and the robot's model on its stand
    diagnosis/                      report.html, report.json, effects.yaml, model.xml
    worth/                          what each cause costs the policy before
    distribution.yaml, policy/      what the training drew robots from, and what it made
    deploy/                         the new policy's episodes
    table.md, table.csv             causes, values, costs

A step whose files are there is not done again, so that a loop that was killed goes on at that step.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from envs.effects.file import load_effects, write_effects
from hardware.errors import SafetyError
from hardware.log import Log, read_logs
from sim2real.deployment.actors import Actor, actor_of, load_actor
from sim2real.diagnosis.contract.logged import LoadPolicy, check_logs, has_policy
from sim2real.diagnosis.contract.page import write_page
from sim2real.diagnosis.data.progress import ProgressLines
from sim2real.evaluation import worth_report
from sim2real.evaluation.worth import Cause, price, read_causes
from sim2real.learning.algorithms.base import Parts
from sim2real.learning.trained import Trained
from sim2real.loops.improve.corrected import FILE, corrected, describe
from sim2real.loops.improve.operator import DeclinedError
from sim2real.loops.improve.site import DEPLOYED, Site
from sim2real.loops.improve.steps import diagnosed, learn
from sim2real.loops.improve.story import (
    GOES_ON,
    RESULT,
    WORDS,
    End,
    Round,
    Story,
    table_of,
    words_of,
)
from sim2real.runs.checkpoint import read_metadata
from sim2real.runs.errors import Sim2RealError, Stopped
from sim2real.runs.files import whole_folder
from sim2real.runs.progress import Progress
from sim2real.runs.tables import show

log_ = logging.getLogger(__name__)
POLICY, KNOWN = "policy", "known.yaml"
GUARD_STOPPED = 3  # exit status


@dataclass(frozen=True)
class Plan:
    """How long a loop goes on.

    Args:
        rounds: trainings at most.
        tolerance: part of the simulator's return that counts as nothing.
        rollouts: episodes on each robot that price the causes.
        logs: recordings to start from, in place of the first deployment and recording.
        absent: whether the robot of these logs is not here, so that nothing is deployed.
    """

    rounds: int
    tolerance: float
    rollouts: int
    logs: Sequence[Log] = ()
    absent: bool = False

    def __post_init__(self) -> None:
        if self.rounds < 1 or not 0 <= self.tolerance < 1:
            raise Sim2RealError(
                f"rounds={self.rounds} must be at least 1, and tolerance={self.tolerance} at least "
                "0 and below 1"
            )


@dataclass(frozen=True)
class Improvement:
    """How a loop ended.

    Args:
        end: why, see `story.WORDS`.
        why: the guard's words where it stopped the robot.
        story: the rounds; its `best` is the number of the best policy's.
    """

    end: End
    why: str
    story: Story

    @property
    def exit_status(self) -> int:
        """0; 3 where the guard stopped the robot."""
        return GUARD_STOPPED if self.end == "stopped" else 0


def improve(
    site: Site, parts: Parts, training: dict[str, Any], first: Trained, plan: Plan, out: Path
) -> Improvement:
    """Run rounds until there is nothing to gain, nothing to find, or somebody ends it.

    Args:
        site: the robot.
        parts: what trained the policy.
        training: `algorithm`, further settings of `train`, and how many iterations or frames each
            round adds.
        first: the policy as given.
        plan: when it ends.
        out: the folder of the loop; what it holds is gone on with.

    Raises:
        Sim2RealError: a folder of another loop; a step that cannot be done.
        HardwareError: a robot that is wrong or is not there.
        Stopped: after Ctrl-C; what was done is on disk.
    """
    loop = _Loop(site, parts, training, first, plan, out, Story(plan.tolerance, site.seed))
    loop.refuse_other()
    why = ""
    try:
        end = loop.run()
    except SafetyError as error:
        end, why = "stopped", str(error)
    except DeclinedError:
        end = "declined"
    except KeyboardInterrupt as stop:
        text = f"stopped in round {loop.number}; continue with resume={out}"
        raise Stopped(text, getattr(stop, "exit_code", 130)) from None
    loop.story.write(out, end, loop.about, why)
    log_.info("it ended because %s%s", WORDS[end], f" ({why})" if why else "")
    if end in GOES_ON:
        log_.info("to go on, run the same command with resume=%s", out)
    return Improvement(end, why, loop.story)


@dataclass
class _Loop:
    site: Site
    parts: Parts
    training: dict[str, Any]
    first: Trained
    plan: Plan
    out: Path
    story: Story
    number: int = 0  # of the round in progress

    @property
    def about(self) -> dict[str, Any]:
        """What a loop that goes on must share."""
        site = self.site
        unit = "m less the task's other costs" if site.by_distance else "as the task pays"
        return {
            "given": str(Path(self.first.source or "").resolve()),
            "robot": site.machine.name,
            "seed": site.seed,
            "trials": site.trials,
            "stand": site.stand,
            "unit": unit,
        }

    def refuse_other(self) -> None:
        """Raise Sim2RealError for a folder whose rounds are of another policy or robot."""
        file = self.out / RESULT
        if not file.is_file():
            return
        told = json.loads(file.read_text(encoding="utf-8"))
        for key, value in self.about.items():
            if told.get(key) != value:
                raise Sim2RealError(
                    f"resume={self.out}: that loop has {key}={told.get(key)}, this one {value}; "
                    "a loop goes on with its own settings, or start another folder"
                )

    def add(self, one: Round) -> None:
        """Take a round as done, and write everything about it."""
        self.story.rounds.append(one)
        self.story.write(self.out, None, self.about)
        row = self.story.table().rows[-1]
        text = f"{one.number}: {words_of(one.causes) or 'the policy as given'}"
        log_.info("round %s; simulator %s, robot %s", text, *map(show, row[2:4]))

    def run(self) -> End:
        """Run all rounds; return why they end."""
        site, out, plan, trained = self.site, self.out, self.plan, self.first
        known = self._known()
        fixed = self.parts.environment.fixed
        start = None if plan.logs else site.deploy(trained, out / "round_0" / "deploy")
        self.add(Round(0, str(trained.source), start, site.score(trained, fixed)))
        recordings, given = list(plan.logs), bool(plan.logs)
        for self.number in range(1, plan.rounds + 1):
            if (end := self.story.end()) is not None:
                return end
            place = out / f"round_{self.number}"
            own = given and self.number == 1
            walked = recordings if own else read_logs(self._before(place) / DEPLOYED)
            load = load_actor if own else partial(_same, trained)
            contract = self._interface(walked, load, place)
            if contract == "broken":
                return "interface"
            if not own:
                log_.info("round %d: recording", self.number)
                recordings += site.record(place, self.number)
            log_.info("round %d: diagnosing %d recordings", self.number, len(recordings))
            folder = place / "diagnosis"
            effects = diagnosed(recordings, known, site.seed, folder, ProgressLines())
            if not effects.is_file():
                return "log"
            if not self._corrects(effects):
                return "nothing_found"
            causes = read_causes(effects)
            self._price(causes, trained, place)
            trained = self._retrained(causes, trained, place)
            robot = None if plan.absent else site.deploy(trained, place / "deploy")
            score = site.score(trained, [(c.effect, c.values) for c in causes])
            facts = _facts(place)
            one = Round(
                self.number,
                str(trained.source),
                robot,
                score,
                contract,
                facts["verdict"],
                facts["causes"],
            )
            self.add(one)
            table_of(one, facts["gap"]).write(place / "table", f"Round {self.number}")
            if plan.absent:
                return "no_robot"
        return self.story.end() or "rounds"

    def _before(self, place: Path) -> Path:
        return place.with_name(f"round_{self.number - 1}")

    def _known(self) -> Path | None:
        """Write down what the policy's simulator had from the start."""
        fixed = self.parts.environment.fixed
        if not fixed:
            return None
        path = self.out / KNOWN
        self.out.mkdir(parents=True, exist_ok=True)
        write_effects(path, fixed)
        return path

    def _corrects(self, effects: Path) -> bool:
        """Return whether effects are others than the simulator had from the start."""
        found = [(effect.label(), values) for effect, values in load_effects(effects)]
        fixed = self.parts.environment.fixed
        return found != [(effect.label(), tuple(values)) for effect, values in fixed]

    def _interface(self, logs: Sequence[Log], load: LoadPolicy, place: Path) -> str | None:
        """Check what the policy saw and did; return the verdict, None where nothing says it."""
        own = [log for log in logs if has_policy(log)]
        if not own:
            return None
        try:
            answer = check_logs(own, load_policy=load)
        except Sim2RealError as error:
            log_.warning("the policy's interface was not checked: %s", error)
            return None
        answer.write(place / "contract.json")
        write_page(answer, place / "contract.html")
        for finding in answer.findings:
            log_.warning("%s: %s; %s", finding.where, finding.text, finding.fix)
        return answer.verdict

    def _price(self, causes: Sequence[Cause], trained: Trained, place: Path) -> None:
        """Say what each cause costs the policy, unless that is done."""
        folder, seed = place / "worth", self.site.seed
        if folder.is_dir():
            return
        log_.info("round %d: what %d causes cost the policy", self.number, len(causes))
        with Progress(1, "robot") as progress:
            rollouts = self.plan.rollouts
            worth = price(trained, causes, rollouts, seed=seed, report=progress.report)
        facts = worth_report.read_diagnosis(place / "diagnosis")
        closed = worth_report.shares_closed(facts, causes)
        about = {"policy": str(trained.source), "effects": str(place / "diagnosis"), "seed": seed}
        with whole_folder(folder) as made:
            worth_report.write(worth, made, closed, about)

    def _retrained(self, causes: Sequence[Cause], trained: Trained, place: Path) -> Trained:
        """Train on from where a policy is, in the simulator with what was found."""
        source = trained.source
        assert source is not None
        log_.info("round %d: training on in the corrected simulator", self.number)
        parts = corrected(self.parts, causes, place)
        describe(place / POLICY, self.out, place / FILE)
        done = read_metadata(source)
        more = {
            "iterations": _sum(self.training["iterations"], done["iteration"]),
            "frames": _sum(self.training["frames"], done["frames"]),
        }
        return learn(place, POLICY, parts, {**self.training, **more}, start=source)


def _same(trained: Trained, path: str | Path) -> Actor:
    """Return the policy that a log of ours names, which is at hand."""
    return actor_of(trained, path)


def _sum(more: int | None, done: int) -> int | None:
    return None if more is None else int(more) + int(done)


def _facts(place: Path) -> dict[str, Any]:
    """Return the verdict of a round's diagnosis, its gap in a sentence, and causes with costs."""
    report = worth_report.read_diagnosis(place / "diagnosis")
    worth = json.loads((place / "worth" / "worth.json").read_text(encoding="utf-8"))
    causes = [
        {
            "label": f"{one['effect']}.{one['where']}" if one["where"] else one["effect"],
            "value": one["value"] if isinstance(one["value"], float) else one["value"][0],
            "ci": one["ci"],
            "unit": one["unit"],
            "closed": one["closed"],
            "cost": list(one["cost"]["return"].values()),
        }
        for one in worth["causes"]
    ]
    gap = report["gap"]
    left = "" if gap["after"] is None else f", {gap['after']:.3g} with what was found"
    text = (
        f"Diagnosis: {report['verdict'].replace('_', ' ')}; the recordings are {gap['before']:.3g} "
        f"{gap['unit']} off in the simulator as given{left} (noise {gap['noise_floor']:.3g})."
    )
    return {"verdict": report["verdict"], "gap": text, "causes": causes}
