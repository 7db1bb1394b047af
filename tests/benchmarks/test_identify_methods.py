"""The table and the picture of all methods of identification."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.identify_methods import METHODS, TRUTH, Answer, draw, table
from envs.distribution import Distribution, Entry
from envs.effects import make
from envs.marginals import Marginal, uniform
from sim2real.config.compose import compose
from sim2real.identification.held_out import HeldOutScores
from sim2real.identification.outcome import Outcome

EFFECTS = (make("link_mass", where="torso", how="set"), make("ground_friction", how="set"))
PRIOR = Distribution(tuple(Entry(e, (uniform(1.0, 9.0),)) for e in EFFECTS))


def answer(mean: float, judged: HeldOutScores | None) -> Answer:
    """Return one with both parameters at a mean, 0.1 unsure."""
    law = Marginal("normal", mean, 0.1, 1.0, 9.0)
    found = Distribution(tuple(Entry(e, (law,)) for e in EFFECTS))
    return Answer(Outcome(PRIOR, found, judged, np.zeros(2), TRUTH), 12.3)


def test_each_method_has_a_row_and_a_panel(tmp_path: Path) -> None:
    """Means with 90 % of the draws, the share of the gap that is left, and the cost."""
    answers = {
        "cma": answer(6.5, HeldOutScores(2.0, 0.5, 0.9, 0.9, 0.1, 0.1)),
        "easi": answer(6.0, None),
    }
    assert list(answers["cma"].outcome.found.names) == list(TRUTH)
    rows = table(answers).rows
    assert rows[0][0] == "cma" and rows[0][3:] == (0.25, 12.0)
    assert rows[1][3] is None
    assert rows[0][1].low == pytest.approx(6.5 - 0.1645)  # type: ignore[union-attr]
    draw(answers, tmp_path / "methods.png")
    assert (tmp_path / "methods.png").stat().st_size > 10_000


@pytest.mark.parametrize("method", list(METHODS))
def test_its_words_are_settings(method: str) -> None:
    """Each method's words compose."""
    task = compose(["run=identify", "log=x", "params=mass_friction", *METHODS[method]])
    assert task["identify"]["_target_"].startswith("sim2real.identification.methods.")
