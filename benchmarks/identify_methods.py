"""The methods of `run=identify` on the same logs: what each answers, and what it costs.

    python -m benchmarks.identify_methods                # some minutes

A policy hops on a simulated Hopper whose torso and ground differ from the model's; eight episodes
are logged, with all that any method asks for. Each method gets them with the same prior, once: the
table and the picture show what answers look like, and not which method is the best.
"""

import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks.easi.demonstrations import demonstrate
from benchmarks.study import command, sim2real, trained
from envs.models import named
from envs.tasks import Hopper
from sim2real.config.compose import compose, instantiate
from sim2real.identification.outcome import Outcome, legend, panel
from sim2real.runs.figures import figure
from sim2real.runs.files import write_text
from sim2real.runs.statistics import Interval
from sim2real.runs.tables import Table

NAME = "identify_methods"
EPISODES, SEED = 8, 0
TRUTH = {"link_mass.torso": 6.5, "ground_friction": 1.8}  # kg, coefficient
HIDDEN = """\
- {{effect: link_mass, where: torso, value: {more}}}
- {{effect: ground_friction, value: {friction}}}
"""
TRAINING = ("+experiment=es_dr", "frames=1000000", "eval=none", "video=none")
FEW = ("transitions=50", "samples=30", "search.generations=30")  # a fiftieth of DROPO's usual cost
METHODS = {  # what stands on the command line behind log, model, params and checkpoint
    "cma": ("identify=cma", "identify.search.generations=30"),
    "nearby": ("identify=nearby",),
    "dropo": ("identify=dropo", *(f"identify.{word}" for word in FEW)),
    "simopt": (
        *("identify=simopt", "identify@identify.method=dropo", "identify.rounds=3"),
        *(f"identify.method.{word}" for word in FEW),
    ),
    "npe": ("identify=npe", "identify.simulations=300", "identify.calibrations=50"),
    "easi": ("identify=easi", "identify.search.population=60", "identify.search.generations=25"),
}
ACROSS, WIDE, HIGH = 2, 9.6, 1.9  # panels side by side; inches of the picture and of a panel
NINETY = 1.645  # standard deviations to either side that hold 90 %


class Answer(NamedTuple):
    """What a method said, and its processor time [s]."""

    outcome: Outcome
    seconds: float


def record(out: Path) -> bool:
    """Train the policy and log its episodes on the hidden robot; return whether that worked."""
    policy, hidden = out / "policy", out / "hidden.yaml"
    if not trained(policy) and not sim2real(*TRAINING, f"seed={SEED}", f"hydra.run.dir={policy}"):
        return False
    spec = named(Hopper().spec())
    mass, friction = TRUTH.values()
    more = mass - float(spec.compile().body("torso").mass[0])
    write_text(hidden, HIDDEN.format(more=more, friction=friction))
    write_text(out / "hopper.xml", spec.to_xml())
    demonstrate(policy, EPISODES, SEED, out / "log.csv", str(hidden))
    return True


def ask(method: str, out: Path) -> Answer:
    """Return a method's answer to the recorded episodes."""
    given = {
        "run": "identify",
        "log": out / "log.csv",
        "model": out / "hopper.xml",
        "checkpoint": out / "policy",
        "params": "mass_friction",
        "seed": SEED,
    }
    words = [f"{key}={value}" for key, value in given.items()]
    begun = time.process_time()
    verb, arguments = instantiate(compose([*words, *METHODS[method]]), out / method)
    outcome = verb(**arguments)._replace(truth=TRUTH)
    return Answer(outcome, time.process_time() - begun)


def table(answers: Mapping[str, Answer]) -> Table:
    """Return a row a method: means with 90 % of the draws, and the cost."""
    made = Table(["method", *TRUTH, "held-out gap", "processor time (s)"])
    for method, (outcome, seconds) in answers.items():
        laws = dict(zip(outcome.found.names, outcome.found.laws, strict=True))
        found = [
            Interval(law.mean, law.mean - NINETY * law.std, law.mean + NINETY * law.std)
            for law in (laws[name] for name in TRUTH)
        ]
        judged = outcome.judged
        left = None if judged is None else judged.after / judged.before
        made.add(method, *found, left, float(round(seconds)))
    truth = ", ".join(f"{name} {value:g}" for name, value in TRUTH.items())
    made.notes.append(
        f"`python -m benchmarks.identify_methods`: {EPISODES} episodes of a Hopper, {truth}, seed "
        f"{SEED}. Brackets: 90 % of the draws. Held-out gap: with the mean, over that of the model "
        "as given; EASI holds nothing out."
    )
    return made


def draw(answers: Mapping[str, Answer], path: Path) -> None:
    """Draw a panel a method."""
    down = -(-len(answers) // ACROSS)
    with figure(path, down, ACROSS, (WIDE, HIGH * down + 0.5)) as (fig, axes):
        for ax in axes.ravel()[len(answers) :]:
            ax.set_axis_off()
        for ax, (method, answer) in zip(axes.ravel(), answers.items(), strict=False):
            panel(ax, answer.outcome)
            ax.set_title(method)
        fig.legend(handles=legend(truth=True), loc="outside lower center", ncols=4)


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and run; return the exit status."""
    parser = command(NAME, __doc__, "out", "results")
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=METHODS)
    chosen = parser.parse_args(arguments)
    out = chosen.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    if not record(out):
        return 1
    answers = {method: ask(method, out) for method in chosen.methods}
    made = table(answers)
    made.write(chosen.results / NAME)
    draw(answers, chosen.results / f"{NAME}.png")
    print(made.markdown())
    return 0


if __name__ == "__main__":
    sys.exit(main())
