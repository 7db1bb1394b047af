"""A population's episodes spread over the machines of a Ray cluster.

    ray start --head                        # on one machine, and on the others what it prints
    python -m sim2real +experiment=esmaml cluster=ray cluster.workers=16

    with Cluster(address="auto", workers=16, rows=32, refill=1).attached(learner):
        learner.iterate()                   # the same numbers as without

Each worker is a process with one batched environment, on a separate CPU; see
`sim2real.learning.population.remote` for what is said to it. Results are those of a local run, bit
for bit on the same kind of processor, and the episodes of a worker that dies run again elsewhere.

Every machine needs the same Python packages and this project, installed or at the same path.
"""

import importlib
import importlib.util
import logging
import os
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from envs.rows import Rows
from sim2real.learning.algorithms.base import Algorithm
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.population.flat_policy import FlatPolicy
from sim2real.learning.population.remote import (
    Batch,
    ClusterError,
    Link,
    Make,
    ObservationScaling,
    Outcomes,
    RemotePopulation,
    RemoteShard,
    Worker,
    WorkerLostError,
)

log = logging.getLogger(__name__)
ROOT = Path(__file__).resolve().parents[3]
START_TIMEOUT = 600.0  # s, for a worker to import and build its environment, on a busy machine too


class RayLink:
    """A worker in a Ray cluster.

    Args:
        make: makes its environment.
        policy: the policy of all members.
        refill: see `Population`.

    Raises:
        Lost: when the cluster has no place for it, or it died at once.
    """

    def __init__(self, make: Make, policy: FlatPolicy, refill: int) -> None:
        self._ray = importlib.import_module("ray")
        remote = self._ray.remote(Worker).options(num_cpus=1)
        self.handle = remote.remote(make, policy, refill)
        try:
            self.pid = self._get(self.handle.ready.remote(), START_TIMEOUT)
        except WorkerLostError:
            self._ray.kill(self.handle)
            raise

    def advance(self, frame: ObservationScaling, batch: Batch) -> Outcomes:
        """Do `Worker.advance` there."""
        return self._get(self.handle.advance.remote(frame, batch), None)

    def _get(self, reference: Any, timeout: float | None) -> Any:
        try:
            return self._ray.get(reference, timeout=timeout)
        except self._ray.exceptions.RayTaskError:
            raise  # the worker lives: this is the environment's own error
        except self._ray.exceptions.RayError as error:
            raise WorkerLostError(type(error).__name__) from error


@dataclass(frozen=True)
class Cluster:
    """A Ray cluster and the resources used on it.

    Raises:
        ClusterError: for numbers below 1, or without the package ray.
    """

    # its head's address, as `ray start` prints it; "auto" finds the one on this machine
    address: str
    workers: int  # environments, each in a process on a separate CPU
    rows: int  # episodes side by side in each
    refill: int  # see `Population`

    def __post_init__(self) -> None:
        for name in ("workers", "rows", "refill"):
            if getattr(self, name) < 1:
                raise ClusterError(f"cluster.{name}={getattr(self, name)} must be at least 1")
        if importlib.util.find_spec("ray") is None:
            raise ClusterError(
                "cluster=ray needs the package 'ray', which is not installed here; "
                "install it with: pip install 'sim2real[ray]'"
            )

    @contextmanager
    def attached(self, learner: Algorithm) -> Iterator[None]:
        """Let a learner's population run on the cluster.

        Args:
            learner: an algorithm that has a population, such as ES-MAML.

        Raises:
            ClusterError: when the cluster is not there or too small, or the learner has no
                population.
        """
        local = learner.population
        if local is None:
            raise ClusterError(
                f"cluster=ray distributes populations, but {type(learner).__name__} has none; "
                "use cluster=none"
            )
        make = partial(_rows, learner.parts.environment, self.rows)
        with self._connected() as ray:
            self._check_size(ray)
            log.info("starting %d workers on %s", self.workers, self.address)
            start = partial(_start, make, local.policy, self.refill)
            names = [f"worker {number}" for number in range(self.workers)]
            with ThreadPoolExecutor(self.workers) as pool:
                shards = list(pool.map(lambda name: RemoteShard(start, self.rows, name), names))
            learner.population = RemotePopulation(shards, local.policy, local.space)
            try:
                yield
            finally:
                learner.population = local

    @contextmanager
    def _connected(self) -> Iterator[Any]:
        """Connect to the cluster, and leave it at the end, which ends the workers."""
        ray = importlib.import_module("ray")
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        paths = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
        try:
            ray.init(
                self.address,
                runtime_env={"env_vars": {**threads, "PYTHONPATH": paths}},
                logging_level=logging.WARNING,
                log_to_driver=False,
            )
        except (ConnectionError, RuntimeError, ValueError) as error:
            reason = " ".join(str(error).split())[:200]
            raise ClusterError(
                f"no Ray cluster at cluster.address={self.address} ({reason}); "
                "start one with: ray start --head"
            ) from error
        try:
            yield ray
        finally:
            ray.shutdown()

    def _check_size(self, ray: Any) -> None:
        cpus = int(ray.cluster_resources().get("CPU", 0))
        if cpus < self.workers:
            raise ClusterError(
                f"cluster.workers={self.workers} need a CPU each, but the cluster has {cpus}; "
                "lower cluster.workers, or join more machines with ray start --address"
            )


def _rows(environment: EnvironmentFactory, num_rows: int) -> Rows:
    """Make a worker's environment: one shard."""
    return environment.rows(num_rows)


def _start(make: Make, policy: FlatPolicy, refill: int, patience: float) -> Link | None:
    """Start a worker where a CPU is free within `patience` [s]; None if there is none."""
    ray, end = importlib.import_module("ray"), time.monotonic() + patience
    while ray.available_resources().get("CPU", 0) < 1:
        if time.monotonic() >= end:
            return None
        time.sleep(0.2)
    try:
        return RayLink(make, policy, refill)
    except WorkerLostError as error:
        log.warning("a worker did not start (%s)", error)
        return None
