"""What causes cost a policy: a small one of the bench, whose costs have properties known before."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from sim2real.deployment.trained import load_policy
from sim2real.evaluation.cause_costs import CoalitionRollouts, compute_cause_costs, read_causes
from sim2real.evaluation.worth_open import interval_endpoints
from sim2real.evaluation.worth_report import read_diagnosis, shares_closed
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.trained import SMALL_ES, train

WEAK = {"effect": "motor_strength", "where": "hinge", "value": 0.4, "ci": [0.35, 0.45]}
RUBS = {"effect": "coulomb_friction", "where": "hinge", "value": 0.15, "unit": "N·m"}
NONE = {"effect": "viscous_friction", "where": "hinge", "value": 0.0}
PLAY = {"effect": "backlash", "where": "hinge", "side": "motor", "value": 0.05}


@pytest.fixture(scope="module")
def trained(tmp_path_factory) -> TrainedPolicy:
    """A policy that follows a motion with a pendulum; of zeros, it commands the motion itself."""
    found = load_policy(train(tmp_path_factory.mktemp("es") / "run", SMALL_ES))
    return replace(found, theta=np.zeros_like(found.theta))


def file(folder: Path, *entries: dict) -> Path:
    """Write an effects.yaml."""
    path = folder / "effects.yaml"
    path.write_text(yaml.safe_dump(list(entries)))
    return path


def test_costs_add_up_to_what_all_cost(trained: TrainedPolicy, tmp_path: Path) -> None:
    """Of three causes, the one that is nothing costs exactly nothing; the others add up."""
    worth = compute_cause_costs(
        trained, read_causes(file(tmp_path, WEAK, RUBS, NONE)), 8, resamples=200
    )
    costs = [cost.value for cost in worth.costs["return"]]
    lost = worth.plain["return"].value - worth.every["return"].value
    assert worth.exact
    assert sum(costs) == pytest.approx(lost)
    assert costs[2] == 0.0 and worth.costs["return"][2].high == 0.0
    assert costs[0] > 0 and worth.costs["return"][0].low > 0
    assert worth.alone["return"][0].value > 0
    assert worth.costs["fall"][0].value == 0.0  # nothing falls on the bench


def test_the_same_episodes_are_played_on_all_robots(trained: TrainedPolicy, tmp_path: Path) -> None:
    """A seed decides all; values vary by their interval; a batch changes no episode."""
    causes = read_causes(file(tmp_path, WEAK, RUBS))
    game = CoalitionRollouts(trained, causes, 6, seed=3)
    weak, every = frozenset({0}), frozenset({0, 1})
    both, alone = (
        game.play([weak, every]),
        CoalitionRollouts(trained, causes, 6, seed=3).play([weak]),
    )
    np.testing.assert_array_equal(both[weak].returns, alone[weak].returns)
    values = game._values(0, 0.0, 2.0)[:, 0]
    assert values.std() == pytest.approx(0.05 / 1.645, rel=0.8)
    assert len(set(values)) == 6
    np.testing.assert_array_equal(game._values(1, 0.0, 9.0)[:, 0], np.full(6, 0.15))


def test_play_takes_a_robot_of_its_own(trained: TrainedPolicy, tmp_path: Path) -> None:
    """What adds joints stands beside what does not, and without it the model has none."""
    causes = read_causes(file(tmp_path, PLAY, WEAK))
    game = CoalitionRollouts(trained, causes, 4, seed=0)
    outcomes = game.play([frozenset(), frozenset({0}), frozenset({1}), frozenset({0, 1})])
    plain = trained.run_episodes(game.seeds, game.world([]))
    np.testing.assert_array_equal(outcomes[frozenset()].returns, plain.returns)
    assert not np.array_equal(outcomes[frozenset({0})].returns, plain.returns)


def test_of_many_causes_orders_are_drawn(trained: TrainedPolicy, tmp_path: Path) -> None:
    """Six causes: not all 64 robots, and costs add up all the same."""
    more = [
        {"effect": name, "where": "hinge", "value": value}
        for name, value in (("armature", 2e-4), ("viscous_friction", 5e-3), ("position_gain", 0.7))
    ]
    delay = {"effect": "command_delay", "where": None, "value": 0.01}
    causes = read_causes(file(tmp_path, WEAK, RUBS, *more, delay))
    worth = compute_cause_costs(trained, causes, 4, orders=4, resamples=100)
    assert not worth.exact
    lost = worth.plain["return"].value - worth.every["return"].value
    assert sum(cost.value for cost in worth.costs["return"]) == pytest.approx(lost)


def test_what_is_not_excluded_is_priced(trained: TrainedPolicy, tmp_path: Path) -> None:
    """Ends of a cause's interval stand for it, watched effects come on top; the dearest first."""
    causes = read_causes(file(tmp_path, WEAK))
    watched = [
        {"effect": "coulomb_friction", "where": "hinge", "side": None, "interval": [-0.01, 0.2]},
        {"effect": "motor_strength", "where": "hinge", "side": None, "interval": [-0.1, 0.1]},
    ]
    ends = interval_endpoints({"watched": watched}, causes)
    assert [(c.effect.name, c.values[0]) for c in ends] == [
        ("motor_strength", 0.35),
        ("motor_strength", 0.45),
        ("coulomb_friction", -0.01),
        ("coulomb_friction", 0.2),
    ]
    worth = compute_cause_costs(
        trained, causes, 4, excluded=[ends[0], ends[1], ends[3]], resamples=100
    )
    costs = [(one.effect, one.value, one.cost["return"].value) for one in worth.open]
    assert [value for *_, value in costs] == sorted((v for *_, v in costs), reverse=True)
    by_value = {value: cost for _, value, cost in costs}
    assert by_value[0.35] > 0 > by_value[0.45]


def test_a_diagnosis_tells_what_is_closed(tmp_path: Path) -> None:
    """By effect and place, or the body that a joint moves; other files are refused."""
    causes = read_causes(file(tmp_path, WEAK, RUBS))
    told = {"effect": "coulomb_friction", "where": "hinge", "closed": 0.8, "extra": {}}
    assert shares_closed({"causes": [told]}, causes) == {1: 0.8}
    (tmp_path / "report.json").write_text('{"verdict": "explained"}')
    with pytest.raises(Sim2RealError, match=r"neither the report\.json"):
        read_diagnosis(tmp_path)
    with pytest.raises(Sim2RealError, match="cannot be read"):
        read_diagnosis(tmp_path / "effects.yaml")


def test_wrong_input_is_refused(trained: TrainedPolicy, tmp_path: Path) -> None:
    """No effects, one twice, too few episodes: a sentence each."""
    with pytest.raises(Sim2RealError, match="contains no effects"):
        read_causes(file(tmp_path))
    with pytest.raises(Sim2RealError, match="occurs twice"):
        read_causes(file(tmp_path, WEAK, WEAK))
    causes = read_causes(file(tmp_path, WEAK))
    with pytest.raises(Sim2RealError, match="at least 2"):
        compute_cause_costs(trained, causes, 1)
