"""Deploy, diagnose, price, retrain, deploy again: until the robot does what the simulator promises.

    history = improve(site, parts, training, first, plan, out)
    history.end, history.best                         # "within_noise", 1

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

import json
import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from envs.effects.file import load_effects, write_effects
from hardware.errors import SafetyError
from hardware.log import Log, read_logs
from sim2real.deployment.actors import actor_of, load_actor
from sim2real.deployment.deploy import read_link
from sim2real.diagnosis.data.progress import ProgressLines
from sim2real.evaluation.cause_costs import read_causes
from sim2real.learning.algorithms.base import Components
from sim2real.learning.trained import TrainedPolicy
from sim2real.loops.improve.checks import facts, interface, priced
from sim2real.loops.improve.corrected import FILE, corrected, describe
from sim2real.loops.improve.operator import DeclinedError
from sim2real.loops.improve.site import DEPLOYED, RobotSetup
from sim2real.loops.improve.steps import diagnosed, learn, longer
from sim2real.loops.improve.story import (
    GOES_ON,
    RESULT,
    WORDS,
    End,
    ImprovementHistory,
    Round,
    table_of,
    words_of,
)
from sim2real.loops.improve.target import Target
from sim2real.runs.errors import RunInterrupted, Sim2RealError
from sim2real.runs.tables import format_cell

log_ = logging.getLogger(__name__)
POLICY, KNOWN = "policy", "known.yaml"
GUARD_STOPPED = 3  # exit status


@dataclass(frozen=True)
class Plan:
    """The limits of a loop."""

    rounds: int  # trainings at most
    tolerance: float  # relative difference below which returns count as equal
    rollouts: int  # episodes on each robot that price the causes
    # recordings to start from, in place of the first deployment and recording
    logs: Sequence[Log] = ()
    absent: bool = False  # whether the robot of these logs is not here, so that nothing is deployed

    def __post_init__(self) -> None:
        if self.rounds < 1 or not 0 <= self.tolerance < 1:
            raise Sim2RealError(
                f"rounds={self.rounds} must be at least 1, and tolerance={self.tolerance} at least "
                "0 and below 1"
            )


@dataclass(frozen=True)
class Improvement:
    """The result of a loop."""

    end: End  # why, see `story.WORDS`
    why: str  # the guard's words where it stopped the robot
    story: ImprovementHistory  # the rounds; its `best` is the number of the best policy's

    @property
    def exit_status(self) -> int:
        """0; 3 where the guard stopped the robot."""
        return GUARD_STOPPED if self.end == "stopped" else 0


def improve(
    site: RobotSetup | Target,
    parts: Components,
    training: dict[str, Any],
    first: TrainedPolicy,
    plan: Plan,
    out: Path,
) -> Improvement:
    """Run rounds until nothing is left to gain or to find, or a person ends it.

    Args:
        site: the robot, or what stands for it.
        parts: components that trained the policy.
        training: `algorithm`, further settings of `train`, and how many iterations or frames each
            round adds.
        first: the policy as given.
        plan: when it ends.
        out: the folder of the loop; what it holds is gone on with.

    Raises:
        Sim2RealError: a folder of another loop; a step that cannot be done.
        HardwareError: a robot that is wrong or is not there.
        RunInterrupted: after Ctrl-C; what was done is on disk.
    """
    loop = _Loop(
        site, parts, training, first, plan, out, ImprovementHistory(plan.tolerance, site.seed)
    )
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
        raise RunInterrupted(text, getattr(stop, "exit_code", 130)) from None
    loop.story.write(out, end, loop.about, why)
    log_.info("it ended because %s%s", WORDS[end], f" ({why})" if why else "")
    if end in GOES_ON:
        log_.info("to go on, run the same command with resume=%s", out)
    return Improvement(end, why, loop.story)


@dataclass
class _Loop:
    site: RobotSetup | Target
    parts: Components
    training: dict[str, Any]
    first: TrainedPolicy
    plan: Plan
    out: Path
    story: ImprovementHistory
    number: int = 0  # of the round in progress
    recordings: list[Log] = field(default_factory=list)  # so far, which are diagnosed together
    contract: str | None = None  # whether the policy saw and did what it was trained on
    effects: Path = Path()  # what was found last

    @property
    def about(self) -> dict[str, Any]:
        """The settings that a continued loop must share."""
        site = self.site
        unit = "m less the task's other costs" if site.by_distance else "as the task pays"
        return {
            "given": str(Path(self.first.source or "").resolve()),
            "robot": site.name,
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
        earlier = json.loads(file.read_text(encoding="utf-8"))
        for key, value in self.about.items():
            if earlier.get(key) != value:
                raise Sim2RealError(
                    f"resume={self.out}: the earlier loop had {key}={earlier.get(key)}, this one "
                    f"{value}; "
                    "give the same settings, or start in another folder"
                )

    def add(self, one: Round) -> None:
        """Take a round as done, and write everything about it."""
        self.story.rounds.append(one)
        self.story.write(self.out, None, self.about)
        row = self.story.table().rows[-1]
        text = f"{one.number}: {words_of(one.causes) or 'the policy as given'}"
        log_.info("round %s; simulator %s, robot %s", text, *map(format_cell, row[2:4]))

    def run(self) -> End:
        """Run all rounds; return why they end."""
        site, trained = self.site, self.first
        robot = None if self.plan.logs else site.deploy(trained, self.out / "round_0" / "deploy")
        score = site.score(trained, self.parts.environment.fixed)
        link = read_link(self.out / "round_0" / "deploy")
        self.add(Round(0, str(trained.source), robot, score, link=link))
        for number in range(1, self.plan.rounds + 1):
            self.number = number
            if (end := self.story.end() or self._looked(trained)) is not None:
                return end
            trained = self._retrained(trained)
            if self.plan.absent:
                return "no_robot"
        return self.story.end() or "rounds"

    @property
    def place(self) -> Path:
        """The folder of the round in progress."""
        return self.out / f"round_{self.number}"

    def _looked(self, trained: TrainedPolicy) -> End | None:
        """Check the interface, record and diagnose; return why nothing follows, if so."""
        given = self.number == 1 and bool(self.plan.logs)
        if given:
            self.recordings = list(self.plan.logs)
        before = self.place.with_name(f"round_{self.number - 1}") / DEPLOYED
        walked = self.plan.logs if given else read_logs(before)
        load = load_actor if given else partial(actor_of, trained)
        self.contract = interface(walked, load, self.place)
        if self.contract == "broken":
            return "interface"
        if not given:
            log_.info("round %d: recording", self.number)
            self.recordings += self.site.record(self.place, self.number)
        log_.info("round %d: diagnosing %d recordings", self.number, len(self.recordings))
        known, folder = self._known(), self.place / "diagnosis"
        self.effects = diagnosed(self.recordings, known, self.site.seed, folder, ProgressLines())
        if not self.effects.is_file():
            return "log"
        return None if self._corrects(self.effects) else "nothing_found"

    def _retrained(self, trained: TrainedPolicy) -> TrainedPolicy:
        """Price what was found, train on with it, deploy, and tell; return the new policy."""
        site, place, source = self.site, self.place, trained.source
        assert source is not None
        causes = read_causes(self.effects)
        log_.info("round %d: what %d causes cost the policy", self.number, len(causes))
        priced(causes, trained, place, self.plan.rollouts, site.seed)
        log_.info("round %d: training on in the corrected simulator", self.number)
        parts = corrected(self.parts, causes, place)
        describe(place / POLICY, self.out, place / FILE)
        made = learn(place, POLICY, parts, longer(self.training, source), start=source)
        robot = None if self.plan.absent else site.deploy(made, place / "deploy")
        score = site.score(made, [(cause.effect, cause.values) for cause in causes])
        report = facts(place)
        found = (self.contract, report["verdict"], report["causes"])
        link = read_link(place / "deploy")
        one = Round(self.number, str(made.source), robot, score, *found, link)
        self.add(one)
        table_of(one, report["gap"]).write(place / "table", f"Round {self.number}")
        return made

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
