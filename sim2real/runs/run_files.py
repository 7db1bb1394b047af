"""Files of a run while it trains: metrics.csv, timing.csv and checkpoints.

    files = RunFiles(out, identity(learner, env), checkpoint_every=10, keep_checkpoints=3)
    files.begin(learner, source=None)
    files.record(learner, learner.iterate(), seconds=1.5, steps=4096)

A row is on disk before the checkpoint of its iteration, so a kill at any moment leaves a checkpoint
and all rows up to it. What a clock says is in timing.csv, apart, because it cannot repeat.
"""

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import Any, Protocol

import yaml

from sim2real.runs.checkpoint import FOLDER, CheckpointStore, Stateful, restore, run_folder
from sim2real.runs.errors import CheckpointError, DiskError, Sim2RealError
from sim2real.runs.metrics import MetricsFile
from sim2real.runs.settings import decisive

log = logging.getLogger(__name__)
STEP = "train/iteration"
SCORE = "train/return"
PACKAGES = ("mujoco", "numpy", "torch")


class Checkpointable(Stateful, Protocol):
    """An object with state and progress to save; an `Algorithm` is one."""

    frames: int
    iteration: int


class RunFiles:
    """The files of one run.

    Args:
        out: the run's folder.
        identity: what a checkpoint must share with a run that continues it.
        checkpoint_every: iterations between checkpoints.
        keep_checkpoints: how many of the newest stay; the one of the highest return stays too.

    Raises:
        Sim2RealError: for an interval or a number of checkpoints below 1.
    """

    def __init__(
        self, out: Path, identity: dict[str, Any], checkpoint_every: int, keep_checkpoints: int
    ) -> None:
        if checkpoint_every < 1:
            raise Sim2RealError(f"checkpoint_every={checkpoint_every} must be at least 1 iteration")
        self.out = out
        self.metrics = MetricsFile(out / "metrics.csv")
        self.timing = MetricsFile(out / "timing.csv")
        self.store = CheckpointStore(out / FOLDER, keep_checkpoints)
        self.config = _config(out)
        self._identity, self._every = identity, checkpoint_every
        self._saved, self._score = 0, float("nan")

    def begin(self, algorithm: Checkpointable, source: Path | None) -> None:
        """Start a new run, or continue from the checkpoint `source` of another run or of this one.

        Raises:
            CheckpointError: for one that does not fit or has another seed, or a folder that already
                holds a run.
            DiskError: when the folder cannot be written.
        """
        if source is None:
            if newest := self.store.latest():
                raise CheckpointError(
                    f"{self.out} already holds a run; continue it with resume={newest}"
                )
            self.metrics.clear()  # of a run that was killed before its first checkpoint
            self.timing.clear()
            return
        found = restore(source, algorithm, self._identity)
        self._compare(source, found)
        self._saved, self._score = algorithm.iteration, float(found[SCORE])
        with self.writing():
            self.store.adopt(source)
            for file in (self.metrics, self.timing):
                former = MetricsFile(run_folder(source) / file.path.name)
                file.truncate(STEP, algorithm.iteration, former)
        log.info("continuing %s after iteration %d", source, algorithm.iteration)

    def _compare(self, source: Path, found: Mapping[str, Any]) -> None:
        """Refuse another seed; warn where settings or versions are not those of the checkpoint."""
        then, now = found.get("config") or {}, self.config
        if then and now and then.get("seed") != now.get("seed"):
            raise CheckpointError(
                f"resume={source}: that run has seed={then.get('seed')}, this one "
                f"seed={now.get('seed')}; a run keeps its seed: give seed={then.get('seed')}"
            )
        pairs = (decisive(then), decisive(now)) if then and now else ({}, {})
        differ = [key for key, value in pairs[0].items() if value != pairs[1][key]]
        versions = _versions()
        differ += [name for name, version in (found.get("versions") or {}).items()
                   if versions.get(name) != version]  # fmt: skip
        if differ:
            log.warning(
                "%s differ from those of %s; results will differ from those of an uninterrupted "
                "run",
                ", ".join(differ),
                source,
            )

    def record(
        self, algorithm: Checkpointable, metrics: dict[str, float], seconds: float, steps: int
    ) -> dict[str, float]:
        """Write the rows of an iteration, and a checkpoint if one is due.

        Args:
            algorithm: after the iteration.
            metrics: what it returned.
            seconds: how long it took [s].
            steps: environment steps that it took.

        Returns:
            All that was written.

        Raises:
            DiskError: when the files could not be written.
        """
        self._score = metrics.get(SCORE, float("nan"))
        step = {STEP: algorithm.iteration}
        clock = {"time/seconds": seconds, "time/fps": steps / max(seconds, 1e-9)}
        with self.writing():
            self.metrics.write(step | metrics)
            self.timing.write(step | clock)
        if algorithm.iteration >= self._saved + self._every:
            self.save(algorithm)
        return step | metrics | clock

    def save(self, algorithm: Checkpointable) -> None:
        """Write a checkpoint of the present state, unless there is one."""
        if algorithm.iteration == self._saved:
            return
        facts = self._identity | {
            "frames": algorithm.frames,
            SCORE: self._score,
            "config": self.config,
            "versions": _versions(),
        }
        self.store.save(algorithm, algorithm.iteration, facts, self._score)
        self._saved = algorithm.iteration

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Turn an error of the file system into a sentence that says what is safe and what to do.

        Raises:
            DiskError: for any OSError inside.
        """
        try:
            yield
        except OSError as error:
            newest = self.store.latest()
            again = f"continue with resume={newest}" if newest else "start again"
            raise DiskError(
                f"the run's files in {self.out} could not be written ({error.strerror or error}); "
                f"the run stops; {DiskError.remedy(error)}, then {again}"
            ) from error


def _config(out: Path) -> dict[str, Any]:
    """Return the configuration that the command line left in a run's folder; {} without one."""
    path = out / "config.yaml"
    return yaml.safe_load(path.read_text(encoding="utf-8")) if path.is_file() else {}


def _versions() -> dict[str, str]:
    """Return the versions of the packages that decide what a run computes."""
    return {name: metadata.version(name) for name in PACKAGES}
