"""The verb `worth`: its files, and what it refuses."""

import json
from pathlib import Path

import pytest
import yaml

from envs.errors import EnvsError
from sim2real.config.compose import compose, instantiate
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.trained import SMALL_ES, run_verb, train

WEAK = {"effect": "motor_strength", "where": "hinge", "value": 0.5, "ci": [0.4, 0.6]}
RUBS = {"effect": "coulomb_friction", "where": "hinge", "value": 0.1}


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """A policy for the bench."""
    return train(tmp_path_factory.mktemp("es") / "run", SMALL_ES)


def price(run: Path, out: Path, *entries: dict, words: tuple[str, ...] = ()) -> None:
    """Run the verb on causes."""
    out.mkdir(exist_ok=True)
    (out / "effects.yaml").write_text(yaml.safe_dump(list(entries)))
    given = [f"checkpoint={run}", f"effects={out / 'effects.yaml'}", "rollouts=4", *words]
    run_verb(["run=worth", *given], out)


def test_a_diagnosis_and_a_policy_make_a_table_and_a_picture(run: Path, tmp_path: Path) -> None:
    """Costs beside what each cause closes; the ends of intervals; all of it on disk."""
    causes = [{**WEAK, "closed": 0.7, "extra": {}}, {**RUBS, "closed": 0.2, "extra": {}}]
    (tmp_path / "report.json").write_text(json.dumps({"causes": causes}))
    price(run, tmp_path / "out", WEAK, RUBS, words=(f"diagnosis={tmp_path}",))
    facts = json.loads((tmp_path / "out" / "worth.json").read_text())
    assert [cause["closed"] for cause in facts["causes"]] == [0.7, 0.2]
    assert facts["exact"] and facts["episodes"] == 4
    total = sum(cause["cost"]["return"]["value"] for cause in facts["causes"])
    lost = facts["plain"]["return"]["value"] - facts["every"]["return"]["value"]
    assert total == pytest.approx(lost)
    assert sorted(one["value"] for one in facts["open"]) == [0.4, 0.6]
    assert "motor_strength.hinge" in (tmp_path / "out" / "table.md").read_text()
    assert "0.4" in (tmp_path / "out" / "open.md").read_text()
    assert (tmp_path / "out" / "plots" / "worth.png").stat().st_size > 5000


def test_what_cannot_be_priced_is_refused(run: Path, tmp_path: Path) -> None:
    """No causes, and an effect that the robot cannot have."""
    verb, arguments = instantiate(compose(["run=worth", f"checkpoint={run}"]), tmp_path)
    with pytest.raises(Sim2RealError, match="give effects=PATH"):
        verb(**arguments)
    with pytest.raises(EnvsError, match="knee"):
        price(run, tmp_path / "out", {**WEAK, "where": "knee"})
