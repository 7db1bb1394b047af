"""The speed comparison measures what it says; nothing here looks at a clock's figure."""

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.load import ForeignLoad
from benchmarks.report import THRESHOLDS, document, table, write
from benchmarks.rows.base import Row, Timing
from benchmarks.rows.batched import BatchedEnv, Collected, make_env
from benchmarks.rows.others import EnvPool, GymnasiumTorch, Vectorized
from benchmarks.rows.physics import Advance, Recorder, Replay, Start
from benchmarks.rows.population import ESPopulation, Evaluation
from benchmarks.speed import Measured, compare, default_rows
from benchmarks.workers import Loop
from benchmarks.world import controller, make_simulation
from sim2real.learning.population.population import Population

NAMES = {
    *("raw_physics", "batched_env_n256", "batched_env_n1024", "collector", "envpool"),
    *("gymnasium_torch", "gymnasium_vector", "torchrl_gymenv_collector", "torchrl_parallel"),
    *("es_population", "es_two_processes_torch", "es_two_processes_numpy"),
}


class Fixed(Row):
    """A row of known speeds."""

    setup = "nothing"

    def __init__(self, name: str, of: str | None, *seconds: float) -> None:
        self.name, self.of, self.closed = name, of, False
        self._seconds = iter(seconds)

    def build(self) -> None:
        """Do nothing."""

    def run(self) -> Timing:
        """Return the next speed."""
        return Timing(100, next(self._seconds), 4)

    def close(self) -> None:
        """Remember it."""
        self.closed = True


class Absent(Fixed):
    """A row whose package is not there."""

    needs = "a_package_that_is_not_there"


def measured(name: str, of: str | None, *rates: float) -> Measured:
    """Return a row that ran at these rates."""
    return Measured(
        Fixed(name, of), [Timing(int(rate), 1.0, 2) for rate in rates], [0.0] * len(rates)
    )


def test_default_rows_have_the_public_names_and_divisors_that_exist() -> None:
    """Every promised row is there once, and is divided by another that runs before it."""
    names = [row.name for row in default_rows(0.01)]
    assert set(names) >= NAMES
    assert len(names) == len(set(names))
    for row in default_rows(0.01):
        assert row.of is None or names.index(row.of) < names.index(row.name)
    assert {name for threshold in THRESHOLDS for name in (threshold.row, threshold.of)} <= set(
        names
    )


def test_ratio_is_the_median_over_rounds() -> None:
    """A round that was slow for both rows leaves their ratio alone."""
    result = document(
        [measured("raw_physics", None, 100, 20, 110), measured("x", "raw_physics", 50, 10, 66)],
        [],
        {},
    )
    raw, x = result["rows"]
    assert (raw["ratio"], raw["per_second"]) == (1.0, 100)
    assert (x["ratio"], x["of"], x["runs"]) == (0.5, "raw_physics", [50, 10, 66])


def test_row_without_its_divisor_has_no_ratio() -> None:
    """Choosing some rows leaves the ratios of the others open instead of inventing them."""
    result = document([measured("x", "raw_physics", 10)], [], {})
    assert result["rows"][0]["ratio"] is None
    assert all(line["ratios"] == [] for line in result["thresholds"])


def test_written_files_hold_the_same_figures(tmp_path: Path) -> None:
    """bench.json reads back, the table says which threshold fails, the picture is a PNG."""
    rows = [measured("raw_physics", None, 100), measured("batched_env_n256", "raw_physics", 70)]
    machine = {"cpu": "c", "cores": 2, "torch_threads": 1, "omp_num_threads": "1"}
    result = document(rows, ["envpool: not here"], machine)
    write(result, tmp_path)
    assert json.loads((tmp_path / "bench.json").read_text()) == result
    assert (
        "| batched_env_n256 / raw_physics | 0.700 |  | 0.7 to 0.7 | 0.82 | 0.95 | **no** |"
        in table(result)
    )
    assert "Skipped envpool" in (tmp_path / "table.md").read_text()
    assert (tmp_path / "bench.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bench.json", "bench.png", "table.md"]


def test_median_has_an_interval() -> None:
    """Of fifteen rounds it is from about the fourth to the twelfth; four rounds get none."""
    machine = {"cpu": "c", "cores": 2, "torch_threads": 1, "omp_num_threads": "1"}

    def line(count: int) -> list[str]:
        raw = measured("raw_physics", None, *[100] * count)
        own = measured("batched_env_n256", "raw_physics", *range(80, 80 + count))
        text = table(document([raw, own], [], machine))
        found = next(row for row in text.splitlines() if "| batched_env_n256 / raw" in row)
        return [cell.strip() for cell in found.split("|")]

    assert line(4)[3] == "" and line(15)[2:5:2] == ["0.870", "0.8 to 0.94"]
    low, high = map(float, line(15)[3].split(" to "))
    assert low == pytest.approx(0.83, abs=0.011) and high == pytest.approx(0.91, abs=0.011)


def test_rows_take_turns_and_missing_packages_are_skipped() -> None:
    """Each row runs once before any runs twice, and one line says what is missing."""
    rows = [Fixed("a", None, 1, 2), Fixed("b", "a", 4, 8), Absent("c", "a")]
    said: list[str] = []
    result, skipped = compare(rows, 2, said.append, patience=0)
    assert [[timing.seconds for timing in one.timings] for one in result] == [[1, 2], [4, 8]]
    assert [line.split()[2] for line in said if line.startswith("round")] == ["a", "b", "a", "b"]
    assert len(skipped) == 1
    assert "pip install" in skipped[0]
    assert [row.closed for row in rows] == [True, True, False]


def test_replay_repeats_the_environment_bit_for_bit() -> None:
    """Raw physics does the work of the environment: same states at the end, through resets."""
    torch.set_num_threads(1)
    recorder = make_simulation(4, 1, Recorder)
    row = BatchedEnv("x", 4, 40, "fresh")
    env = make_env(recorder)
    row.build()
    start = row._warm(env)
    recorder.restart()
    row._timed(env, start)
    assert sum(isinstance(item, Start) for item in recorder.tape) > 2  # episodes ended within
    replay = Replay(4, recorder.tape, threads=2)
    assert replay.run().steps == 160
    last = recorder.plant.qpos
    assert np.array_equal(replay.batch.bind("qpos"), last)


def test_packed_tape_holds_every_step_of_every_episode_once() -> None:
    """The raw physics of a population steps as often as the population, in rows that stay full."""
    job = Evaluation(6, 2, "fresh")
    row = ESPopulation("x", job, 2, "y")
    row.build()
    timing = row.run()
    tape = job.tape(3)
    assert sum(len(item.control) for item in tape if isinstance(item, Advance)) == timing.steps
    assert sum(len(item.ids) for item in tape if isinstance(item, Start)) == timing.episodes == 12
    assert Replay(3, tape, threads=1).run().steps == timing.steps


@pytest.mark.parametrize("kind", ["torch", "numpy"])
def test_gymnasium_loop_runs_the_population_s_episodes(kind: str) -> None:
    """The baseline evaluates the same members on the same robots, and returns as much of them."""
    job = Evaluation(5, 1, "fresh")
    population = Population([make_simulation(5, 1)], job.controller.policy)
    results = population.run(job.members(), job.controller.normalizer())
    loop = Loop(kind)  # type: ignore[arg-type]
    outcomes = [loop.episode(member) for member in job.sample(5)]
    assert sorted(outcome.steps for outcome in outcomes) == sorted(results.lengths[:, 0])
    totals = sorted(outcome.total for outcome in outcomes)
    np.testing.assert_allclose(totals, sorted(results.returns[:, 0]), rtol=1e-4)
    for sums in ("sums", "squares"):
        found = sum(getattr(outcome, sums) for outcome in outcomes)
        np.testing.assert_allclose(found, getattr(results, sums), rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("gait", ["hopping", "fresh"])
def test_network_is_the_population_s_policy(gait: str) -> None:
    """The torch network that other rows run computes the same actions."""
    control = controller(gait)  # type: ignore[arg-type]
    slots = control.policy.slots(3)
    slots.load(np.arange(3), np.tile(control.theta, (3, 1)))
    observation = np.random.default_rng(0).standard_normal((3, 11)) + control.mean
    expected = slots.act(None, (observation - control.mean) / control.normalizer().std)
    with torch.no_grad():
        given = control.network()(torch.from_numpy(observation).float()).numpy()
    np.testing.assert_allclose(given, expected, atol=2e-5)


def test_hopping_policy_stays_up() -> None:
    """Its episodes are long enough to be called long."""
    job = Evaluation(8, 1, "hopping")
    row = ESPopulation("x", job, 4, "y")
    row.build()
    timing = row.run()
    assert timing.steps / timing.episodes > 200


@pytest.mark.parametrize(
    ("row", "steps"),
    [
        (GymnasiumTorch(30, "fresh"), 30),
        (Vectorized("gymnasium_vector", 2, 20, "fresh", ""), 40),
        (Collected("collector", 4, lambda: make_env(make_simulation(4)), 40, 2, "fresh", ""), 80),
        pytest.param(
            EnvPool("envpool", 4, 20, "fresh", ""), 80,
            marks=pytest.mark.skipif(not find_spec("envpool"), reason="needs envpool"),
        ),
    ],
    ids=lambda value: getattr(value, "name", ""),
)  # fmt: skip
def test_row_makes_the_steps_that_it_counts(row: Row, steps: int) -> None:
    """A short run of each kind counts its steps, and with a fresh policy episodes end."""
    row.build()
    try:
        timing = row.run()
    finally:
        row.close()
    assert timing.steps == steps
    assert timing.episodes > 0
    assert timing.seconds > 0


def test_foreign_load_leaves_out_this_process() -> None:
    """Work of this very process is not counted as another's."""
    import time

    load, begin, number = ForeignLoad(), time.process_time(), 0
    while time.process_time() - begin < 0.3:
        number += 1
    own = load.cores()
    everything, start = load._read(), load._start
    busy = (everything[1] - start[1]) / (everything[0] - start[0])
    assert own < busy


def test_dead_grandchildren_of_a_living_child_are_own_work() -> None:
    """A row's process forks helpers that end before it does."""
    burn = "import time\nwhile time.process_time() < 0.5: pass"
    child = (
        "import subprocess, sys\n"
        f"subprocess.run([sys.executable, '-c', {burn!r}], check=True)\n"
        "print('done', flush=True)\nsys.stdin.read()"
    )
    load = ForeignLoad()
    with subprocess.Popen(
        [sys.executable, "-c", child], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline().strip() == b"done"
        now = load._read()
        process.communicate(b"")
    tick = 1 / os.sysconf("SC_CLK_TCK")  # user and system come in whole ticks
    assert now[2] - load._start[2] >= 0.5 - 4 * tick  # s of CPU time
