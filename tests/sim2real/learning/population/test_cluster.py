"""Episodes in other processes: the numbers of a local run, whatever dies."""

import importlib
import importlib.util
import itertools
import logging
import os
import signal
import threading
from collections.abc import Callable, Container, Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest

from envs.toys import Nav2D, NavGoals, ToyEnv
from sim2real.learning.adapt import HillClimb
from sim2real.learning.algorithms.base import Algorithm, Components
from sim2real.learning.algorithms.esmaml import ESMAML, ESMAMLSettings
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.modules.mlp_policy import mlp_policy
from sim2real.learning.population.cluster import Cluster
from sim2real.learning.population.flat_policy import FlatPolicy
from sim2real.learning.population.remote import (
    Batch,
    ClusterError,
    Link,
    ObservationScaling,
    Outcomes,
    RemotePopulation,
    RemoteShard,
    Worker,
    WorkerLostError,
)

ES = {
    "num_rows": 16, "shards": 1, "refill": 1, "pairs": 6, "sigma": 0.1, "learning_rate": 0.1,
    "optimizer": "adam", "estimator": "antithetic", "shaping": "none", "top_k": 0,
    "orthogonal": False, "weight_decay": 0.0, "paired_tasks": True, "tasks_per_member": 1,
    "final_episodes": 2, "step_cost": 0.0, "normalize_observations": True,
    "meta_estimator": "zeroth_order", "first_order_queries": 2, "clean_final": (),
}  # fmt: skip
SHORT = partial(Nav2D, max_steps=20)


def learner() -> ESMAML:
    """Return an algorithm on Nav-2D whose members adapt in three stages."""
    policy = partial(mlp_policy, hidden=(4,), activation="tanh", output="tanh", initial="normal")
    climb = HillClimb(mode="batch", queries=3, parallel=2, sigma=0.1)
    world = EnvironmentFactory(partial(ToyEnv, SHORT), NavGoals())
    return ESMAML(Components(world, policy, 0, climb), ESMAMLSettings(**ES))  # type: ignore[arg-type]


def iterated(algorithm: ESMAML, count: int = 4) -> tuple[list[dict[str, float]], np.ndarray]:
    """Return what `count` iterations said, and the parameters afterwards."""
    return [algorithm.iterate() for _ in range(count)], algorithm.theta


class Near:
    """A worker in this process, which dies at some calls, by the number that `count` gives them."""

    def __init__(self, policy: FlatPolicy, deaths: Container[int], count: Iterator[int]) -> None:
        self._worker = Worker(lambda: SHORT(num_rows=5), policy, 1)
        self._deaths, self._count = deaths, count

    def advance(self, frame: ObservationScaling, batch: Batch) -> Outcomes:
        """Work, and perhaps die before telling."""
        outcomes = self._worker.advance(frame, batch)
        if next(self._count) in self._deaths:
            raise WorkerLostError("killed")
        return outcomes


def spread(algorithm: ESMAML, starts: list[Callable[[float], Link | None]]) -> None:
    """Put an algorithm's population on workers."""
    shards = [RemoteShard(start, 5, f"worker {i}") for i, start in enumerate(starts)]
    local = algorithm.population
    algorithm.population = RemotePopulation(shards, local.policy, local.space)
    assert algorithm.population.num_rows == 5 * len(starts)


@pytest.mark.parametrize("deaths", [set(), {0}, {3, 7, 8, 20}])
def test_remote_numbers_are_the_local_ones(deaths: set[int], caplog: Any) -> None:
    """Metrics and parameters are equal to the last bit, also when workers die with episodes."""
    expected, theta = iterated(learner())
    algorithm = learner()
    calls = itertools.count()
    spread(algorithm, [lambda _: Near(algorithm.policy, deaths, calls)] * 2)
    with caplog.at_level(logging.WARNING):
        metrics, remote = iterated(algorithm)
    assert metrics == expected and np.array_equal(remote, theta)
    assert len([m for m in caplog.messages if "rescheduling its" in m]) == len(deaths)


def test_a_worker_without_a_successor_leaves_the_rest_to_the_others() -> None:
    """Without a place for its successor the run goes on with the rest, until there is one."""
    expected, theta = iterated(learner())
    algorithm = learner()
    places = iter([{2}, None, None, {}])  # of the workers, the calls at which they die

    def start(_: float) -> Link | None:
        deaths = next(places)
        return None if deaths is None else Near(algorithm.policy, deaths, itertools.count())

    spread(algorithm, [lambda _: Near(algorithm.policy, (), itertools.count()), start])
    metrics, remote = iterated(algorithm)
    assert metrics == expected and np.array_equal(remote, theta)
    assert next(places, None) is None


def test_when_all_workers_are_dead_the_run_ends_in_a_sentence() -> None:
    """Nothing waits for ever."""
    algorithm = learner()
    places = iter([True, True])

    def start(_: float) -> Link | None:
        return Near(algorithm.policy, {0}, itertools.count()) if next(places, False) else None

    spread(algorithm, [start, start])
    with pytest.raises(ClusterError, match="all workers died"):
        algorithm.iterate()


def test_a_worker_forgets_what_an_aborted_run_left() -> None:
    """Episodes of a run that ended early never turn up in the next."""
    policy = learner().policy
    worker = Worker(lambda: SHORT(num_rows=2), policy, 1)
    thetas = np.zeros((4, policy.num_parameters), np.float32)
    batch = Batch(np.arange(4), thetas, np.ones((4, 2)), np.arange(4, dtype=np.uint64))
    first = worker.advance(ObservationScaling(1, None, None), batch)
    assert len(first.tickets) < 4
    second = worker.advance(
        ObservationScaling(2, None, None), batch._replace(tickets=np.arange(10, 14))
    )
    assert (second.tickets >= 10).all() and len(second.tickets) > 0


def test_what_cannot_work_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Numbers below 1, a missing package and an algorithm without a population have sentences."""
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: object())
    with pytest.raises(ClusterError, match=r"cluster\.workers=0"):
        Cluster("auto", 0, 1, 1)

    class Other(Algorithm):
        pass

    Other.__abstractmethods__ = frozenset()
    with (
        pytest.raises(ClusterError, match="Other has none"),
        Cluster("auto", 1, 1, 1).attached(Other()),  # type: ignore[abstract]
    ):
        pass
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(ClusterError, match=r"pip install 'sim2real\[ray\]'"):
        Cluster("auto", 1, 1, 1)


@pytest.fixture(scope="module")
def two_nodes() -> Iterator[Any]:
    """Start a cluster of two nodes with one CPU each on this machine."""
    pytest.importorskip("ray")
    utils = importlib.import_module("ray.cluster_utils")
    cluster = utils.Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    cluster.add_node(num_cpus=1)
    yield cluster
    cluster.shutdown()


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_a_ray_cluster_computes_the_local_numbers(two_nodes: Any) -> None:
    """Two workers, one killed in the middle: metrics and parameters to the last bit."""
    expected, theta = iterated(learner(), 6)
    algorithm = learner()
    with Cluster(two_nodes.address, 2, 8, 1).attached(algorithm):
        first, _ = iterated(algorithm, 2)
        shards: list[RemoteShard] = algorithm.population._shards  # type: ignore[assignment]
        victim = shards[0].link.pid  # type: ignore[union-attr]
        timer = threading.Timer(0.02, os.kill, (victim, signal.SIGKILL))
        timer.start()
        rest, remote = iterated(algorithm, 4)
        timer.join()
        assert shards[0].link.pid != victim  # type: ignore[union-attr]
    assert first + rest == expected and np.array_equal(remote, theta)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_too_small_a_cluster_is_refused(two_nodes: Any) -> None:
    """The sentence has both numbers; without any cluster it says how to start one."""
    with (
        pytest.raises(ClusterError, match=r"workers=9 .* the cluster has 2"),
        Cluster(two_nodes.address, 9, 8, 1).attached(learner()),
    ):
        pass
