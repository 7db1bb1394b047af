"""When a loop ends, what its operator says, and what its simulators draw."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.simulation import Simulation
from envs.tasks import Bench1, Hopper2, Quad8
from hardware.backends import ServoBackend
from hardware.body import EmulatedBody
from hardware.config import load_robot
from hardware.env import HardwareEnv
from hardware.rows import RobotRows
from sim2real.config.compose import compose, instantiate
from sim2real.evaluation.cause_costs import Cause
from sim2real.loops.improve.corrected import corrected
from sim2real.loops.improve.operator import DeclinedError, Operator
from sim2real.loops.improve.site import RobotSetup
from sim2real.loops.improve.story import ImprovementHistory, Round
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.trained import note_worlds

ROW, NO_VALUES, SEED = np.arange(1), np.zeros((1, 0)), np.array([3], np.uint64)


def told(*returns: tuple[list[float] | None, list[float]]) -> ImprovementHistory:
    """Return a story of rounds: returns on the robot, and in the simulator."""
    rounds = [Round(number, f"RUN{number}", *one) for number, one in enumerate(returns)]
    return ImprovementHistory(tolerance=0.02, seed=0, rounds=rounds)


def test_it_goes_on_while_the_robot_earns_less_and_rounds_bring_something() -> None:
    """Far behind: on; behind by less than the noise: enough; no more than before: no use."""
    sure, wide = [2.0, 2.1, 1.9, 2.0], [1.0, 3.1, 0.9, 2.9]
    assert told(([0.5, 0.6, 0.4, 0.5], sure)).end() is None
    assert told((sure, wide)).end() == "within_noise"
    assert told(([1.97, 2.07, 1.87, 1.97], sure)).end() == "within_noise"  # 1.5 % are nothing
    assert told(([1.9, 2.0, 1.8, 1.9], sure)).end() is None  # 5 % of every episode are something
    assert told(([3.0, 3.1, 2.9, 3.0], sure)).end() == "within_noise"  # more is no gap
    low = ([0.5, 0.6, 0.4, 0.5], sure)
    assert told(low, ([0.9, 1.0, 0.8, 0.9], sure)).end() is None
    worse = told(low, ([0.4, 0.5, 0.3, 0.4], sure))
    assert (worse.end(), worse.best) == ("no_gain", 0)
    assert told((None, sure), low).end() is None  # nothing is known of the policy before


def test_an_operator_says_yes_or_it_does_not_move() -> None:
    """Enter alone, a closed terminal and anything else are a no."""
    Operator(lambda question: " Yes").consents("It moves.")
    for answer in ("", "n", "yep"):
        with pytest.raises(DeclinedError):
            Operator(lambda question, said=answer: said).consents("It moves.")


def test_a_distance_is_asked_for_until_it_is_a_number() -> None:
    """With a comma or a unit, too; the question says what was wrong."""
    answers, asked = iter(["far", "nan", "0,85 m"]), []

    def ask(question: str) -> str:
        asked.append(question)
        return next(answers)

    assert Operator(ask).distance("episode 1 of 2") == 0.85
    assert asked[0] == "How far did it go in episode 1 of 2 [m, backwards is negative]? "
    assert asked[1].startswith("'far' is not a number of metres")

    def gone(question: str) -> str:
        raise EOFError

    with pytest.raises(Sim2RealError, match="there is no terminal to enter the distance"):
        Operator(gone).distance("episode 1 of 2")


def test_a_distance_makes_the_return_of_a_robot_that_nothing_tracks() -> None:
    """Rewards of a base that seems to rest, and how far it went, are an episode's return."""
    task = Quad8(seconds=1.0).with_distance_reward()
    simulation = Simulation(task, 1, threads=1)
    simulation.reset(ROW, NO_VALUES, SEED)
    start, total, blind = float(simulation.state().qpos[0, 0]), 0.0, 0.0
    rng = np.random.default_rng(0)
    for _ in range(task.max_steps):
        step = simulation.step(None, rng.uniform(-0.3, 0.3, (1, 8)))
        total += float(step.reward[0])
        blind -= task.energy_cost * float(task.power(simulation.state())[0]) * task.dt
    gone = float(simulation.state().qpos[0, 0]) - start
    assert abs(gone) > 0.01
    assert total == pytest.approx(blind + gone, abs=1e-9)
    assert (
        Hopper2(goal="height").with_distance_reward() is None
        and Bench1().with_distance_reward() is None
    )


class Blind(EmulatedBody):
    """An emulated robot's IMU without its tracker."""

    @property
    def names(self) -> tuple[str, ...]:
        """All but the position."""
        return tuple(name for name in self._names if name != "position")

    @names.setter
    def names(self, value: tuple[str, ...]) -> None:
        self._names = value


def test_where_nothing_tracks_the_robot_its_operator_measures(tmp_path: Path, monkeypatch) -> None:
    """The distance is added to each episode, and the simulator's return is of the same kind."""
    words = ["env=quad8", "env.task.seconds=0.4", "policy=linear", "algorithm.num_rows=4"]
    _, given = instantiate(compose(words), tmp_path)
    learner = given["algorithm"](given["parts"])
    trained = learner.trained()

    def backend(site: RobotSetup) -> ServoBackend:
        made = ServoBackend(site.machine, site.settle, seed=site.seed)
        assert made.world is not None
        return ServoBackend(site.machine, site.settle, made.world, sensors=Blind(made.world))

    monkeypatch.setattr(RobotSetup, "_backend", backend)
    operator = Operator(lambda question: "0.5")
    site = the_site(given["parts"].environment, "quad8", operator)
    assert site.by_distance
    built = note_worlds(monkeypatch)
    returns = site.deploy(trained, tmp_path / "deploy")
    assert [type(one) for one in built] == [HardwareEnv]
    rows = RobotRows(site.task, backend(site))
    assert rows.needs()[1] == {"position"}
    assert all(0.3 < one < 0.5 for one in returns)  # the distance less the energy
    walked = site.score(trained)
    assert walked != pytest.approx(returns, abs=0.01)  # it did not walk half a metre


def the_site(environment: object, name: str, operator: Operator, stand: bool = True) -> RobotSetup:
    """Return a robot that is run twice."""
    robot, limits = load_robot(name), ServoBackend(load_robot("bench1"), 0.1)._limits
    return RobotSetup(robot, environment, operator, 2, 0.1, limits, stand, ("ramp",), 1.0, 0)  # type: ignore[arg-type]


def test_the_ground_is_refused_where_nothing_tells_of_the_base(tmp_path: Path) -> None:
    """A pendulum's episodes can be simulated again, a walker's with an IMU, a hopper's."""
    made = {}
    for name in ("bench1", "quad8", "hopper2"):
        made[name] = instantiate(compose([f"env={name}"]), tmp_path)[1]["parts"].environment
        the_site(made[name], name, Operator(), stand=False)
    robot, limits = load_robot("quad8"), ServoBackend(load_robot("bench1"), 0.1)._limits
    rest: Any = (Operator(), 2, 0.1, limits, False, ("ramp",), 1.0, 0)
    with pytest.raises(Sim2RealError, match=r"stand=false: quad8 moves at .* no IMU .* stand=true"):
        RobotSetup(replace(robot, imu=None), made["quad8"], *rest)
    bare = mujoco.MjSpec.from_file(str(robot.model))
    for geom in bare.geoms:
        geom.contype = geom.conaffinity = 0
    (tmp_path / "bare.xml").write_text(bare.to_xml(), encoding="utf-8")
    with pytest.raises(Sim2RealError, match="its model has no ground to stand on"):
        RobotSetup(replace(robot, model=tmp_path / "bare.xml"), made["quad8"], *rest)


@pytest.mark.parametrize("name", ["esmaml", "ppo"])
def test_training_goes_on_from_a_policy_in_another_simulator(name: str, tmp_path, made) -> None:
    """The first policy of the new run is the last of the old one; robots are drawn as found."""
    from sim2real.learning.algorithms.base import build
    from sim2real.learning.training import train
    from sim2real.runs.checkpoint import find, restore

    given = made(name)
    settings = {"logger": given["logger"], "algorithm": given["algorithm"], "frames": None}
    settings |= {"checkpoint_every": 1, "keep_checkpoints": 3, "cluster": None, "resume": None}
    first = train(parts=given["parts"], iterations=1, out=tmp_path / "a", **settings)
    found = [Cause(make("coulomb_friction", where="hinge"), (0.02,), std=0.005)]
    parts = corrected(given["parts"], found, tmp_path)
    same = build(given["algorithm"], parts)
    restore(find(tmp_path / "a"), same, same.identity, generators=False)
    np.testing.assert_array_equal(same.trained().theta, first.trained().theta)
    with pytest.raises(Sim2RealError, match=r"has 1 iterations and \d+ steps already"):
        train(parts=parts, iterations=1, start=tmp_path / "a", out=tmp_path / "b", **settings)
    assert not (tmp_path / "b").exists()
    more = train(parts=parts, iterations=2, start=tmp_path / "a", out=tmp_path / "c", **settings)
    assert more.iteration == 2 and not np.array_equal(more.trained().theta, first.trained().theta)
    drawn = parts.environment.tasks.sample(np.random.default_rng(0), 500)
    assert drawn.mean() == pytest.approx(0.02, abs=0.001) and drawn.min() >= 0.005
    sure = corrected(given["parts"], [replace(found[0], std=0.0)], tmp_path)
    assert np.ptp(sure.environment.tasks.sample(np.random.default_rng(0), 9)) == 0


@pytest.fixture
def made(tmp_path: Path) -> Callable[..., dict]:
    """Return what makes the arguments of a small training."""

    def make_it(name: str) -> dict:
        words = ["env=bench1", "env.task.seconds=0.4", f"algorithm={name}", "algorithm.num_rows=4"]
        small = ["algorithm.pairs=2", "policy=linear"] if name == "esmaml" else []
        small = small or ["algorithm.steps=32", "algorithm.minibatch_size=32"]
        return instantiate(compose([*words, *small]), tmp_path)[1]

    return make_it
