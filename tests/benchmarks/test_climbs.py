"""The comparison of climbs: noise by its law, gains without noise, and what noise does to them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.climbs import NOISES, RULES, gains, height, main, noise


def test_heights_and_noise_are_what_the_table_says() -> None:
    """The start is one below the top; one-sided errors hurt in 30 % of the episodes."""
    assert height(np.zeros((1, 6))) == pytest.approx(-1.0)
    assert height(np.full((1, 6), 6**-0.5)) == pytest.approx(0.0)
    rng = np.random.default_rng(0)
    plain, hurt = noise(rng, "Gaussian", 2.0, 20_000), noise(rng, "corrupted", 2.0, 20_000)
    assert plain.mean() == pytest.approx(0.0, abs=0.05) and plain.std() == pytest.approx(2.0, 0.02)
    assert hurt.max() == 0.0 and (hurt < 0).mean() == pytest.approx(0.3, abs=0.02)


@pytest.mark.parametrize("name", list(RULES))
def test_every_rule_climbs_and_spends_about_fifty_episodes(name: str) -> None:
    """Without noise no climb ends below its start, and budgets differ by three at most."""
    found = gains(RULES[name], "Gaussian", 0.0, 0, 100)
    assert found.min() > -1e-9 and found.mean() > 0.3
    assert 48 <= RULES[name].episodes <= 51


def test_one_sided_errors_fool_whoever_averages_or_asks_again() -> None:
    """What the page concludes, at a tenth of its climbs."""
    found = {name: gains(rule, "corrupted", 2.0, 1, 200).mean() for name, rule in RULES.items()}
    assert found["sequential"] - found["sequential, again"] > 0.4
    assert found["batch"] - found["average"] > 0.5


def test_the_table_has_all_rules_and_noises(tmp_path: Path) -> None:
    """A row for each rule, a column for each noise; the same seed gives the same table."""
    for folder in ("one", "two"):
        assert main(["--climbs", "3", "--results", str(tmp_path / folder)]) == 0
    one, two = (tmp_path / folder / "climbs.md" for folder in ("one", "two"))
    assert one.read_text() == two.read_text()
    assert all(f"| {name} |" in one.read_text() for name in RULES)
    assert one.read_text().count("Gaussian") + one.read_text().count("corrupted") == len(NOISES)
