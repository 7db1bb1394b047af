"""This project's batched environment: stepped by hand, and by a TorchRL collector.

The run restarts from one seed each time, so that each run makes the same steps, and its physics can
be recorded once.
"""

import time
from collections.abc import Callable
from typing import Any, ClassVar

import torch
from tensordict import TensorDictBase
from tensordict.nn import AddStateIndependentNormalScale, TensorDictModule, TensorDictModuleBase
from torch import nn
from torchrl.collectors import Collector
from torchrl.envs import Compose, EnvBase, TransformedEnv
from torchrl.modules import IndependentNormal, ProbabilisticActor

from benchmarks.rows.base import Row, Timing
from benchmarks.rows.physics import Recorder, Tape
from benchmarks.world import THREADS, Gait, controller, make_simulation, make_tasks
from envs.rows import Rows
from envs.torch_env import RandomizeParams, RowsEnv
from sim2real.learning.transforms import RewardScaling, RunningNorm

SEED = 7
QUIET = -5.0  # logarithm of the deviation of actions that are drawn
WARM_UP = 60  # control steps before the clock starts: the rows are then spread over their episodes


def make_env(rows: Rows) -> RowsEnv:
    """Return the randomized Hopper as a user makes it."""
    return RowsEnv(rows, seed=SEED, tasks=make_tasks())


class Actor(TensorDictModuleBase):
    """The policy as TorchRL takes it, for float64 observations too.

    It reads and writes the tensordict by itself: `TensorDictModule` looks for pandas in the file
    system at each call where it is not installed, which costs 0.2 ms.
    """

    in_keys: ClassVar[list[str]] = ["observation"]
    out_keys: ClassVar[list[str]] = ["action"]

    def __init__(self, gait: Gait) -> None:
        super().__init__()
        self.network = controller(gait).network()

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Add the action to the tensordict."""
        return tensordict.set("action", self.network(tensordict.get("observation").float()))


class BatchedEnv(Row):
    """`step_and_maybe_reset` with the policy in the loop."""

    memory = "batched"

    def __init__(
        self, name: str, num_rows: int, steps: int, gait: Gait, of: str = "raw_physics"
    ) -> None:
        self.name, self.of, self.simulations = name, of, num_rows
        self._steps = steps
        self._gait: Gait = gait
        self.setup = f"N = {num_rows}, {THREADS} physics threads, torch policy on 1, {gait}"

    def build(self) -> None:
        """Make the environment."""
        self._actor = Actor(self._gait)
        self._env = make_env(make_simulation(self.simulations))

    def run(self) -> Timing:
        """Start anew, warm up, and time the rest."""
        return self._timed(self._env, self._warm(self._env))

    def record(self) -> Tape:
        """Do the work of a run on rows that record it, and return the tape of what is timed."""
        recorder = make_simulation(self.simulations, kind=Recorder)
        self._actor = Actor(self._gait)
        env = make_env(recorder)
        start = self._warm(env)
        recorder.restart()
        self._timed(env, start)
        return recorder.tape

    @torch.no_grad()
    def _warm(self, env: RowsEnv) -> TensorDictBase:
        env.set_seed(SEED)
        tensordict = env.reset()
        for _ in range(WARM_UP):
            _, tensordict = env.step_and_maybe_reset(self._actor(tensordict))
        return tensordict

    @torch.no_grad()
    def _timed(self, env: RowsEnv, tensordict: TensorDictBase) -> Timing:
        ended = []
        begin = time.perf_counter()
        for _ in range(self._steps):
            done, tensordict = env.step_and_maybe_reset(self._actor(tensordict))
            ended.append(done["next", "done"])
        seconds = time.perf_counter() - begin
        return Timing(
            self._steps * self.simulations, seconds, int(sum(done.sum() for done in ended))
        )


class Collected(Row):
    """A TorchRL collector."""

    def __init__(
        self,
        name: str,
        simulations: int,
        make: Callable[[], EnvBase],
        frames: int,
        batches: int,
        gait: Gait,
        setup: str,
    ) -> None:
        self.name, self.setup, self.simulations = name, setup, simulations
        self.memory = "batched" if simulations > 1 else "gymnasium"
        self._make, self._frames, self._batches = make, frames, batches
        self._gait: Gait = gait

    def build(self) -> None:
        """Make the collector and let it deliver one batch."""
        self._collect(self._make, Actor(self._gait))

    def _collect(self, world: Any, actor: TensorDictModuleBase, **more: bool) -> None:
        self._collector = Collector(
            world,
            actor,
            frames_per_batch=self._frames,
            total_frames=-1,
            no_cuda_sync=True,
            auto_register_policy_transforms=False,
            **more,  # pyright: ignore[reportArgumentType]
        )
        self._batch = iter(self._collector)
        next(self._batch)

    def work(self) -> tuple[float, int]:
        """Take some batches."""
        steps = episodes = 0
        for _ in range(self._batches):
            batch = next(self._batch)
            steps += batch.numel()
            episodes += int(batch["next", "done"].sum())
        return steps, episodes

    def close(self) -> None:
        """End the collector and its environment."""
        self._collector.shutdown()


class TrainingCollected(Collected):
    """A collector as PPO has it: its transforms, and an actor that draws its actions.

    The normalizer begins with what it would converge to, and the actions' deviation is small, so
    that the robots do what they do in the other rows.
    """

    def __init__(self, name: str, frames: int, batches: int, gait: Gait, setup: str) -> None:
        super().__init__(name, 256, self._world, frames, batches, gait, setup)

    def build(self) -> None:
        """Make the collector and let it deliver one batch."""
        self._collect(self._world(), self._drawing(), track_traj_ids=False, trust_policy=True)

    def _world(self) -> EnvBase:
        norm, known = RunningNorm(), controller(self._gait).normalizer()
        norm.moments["observation"].load(known.state_dict())
        base = RowsEnv(make_simulation(self.simulations), seed=SEED)
        transforms: Any = (RandomizeParams(make_tasks()), norm, RewardScaling(0.99))
        return TransformedEnv(base, Compose(*transforms))

    def _drawing(self) -> ProbabilisticActor:
        scale = AddStateIndependentNormalScale(3, init_value=QUIET)
        body = nn.Sequential(controller(self._gait).unfolded(), scale)
        return ProbabilisticActor(
            TensorDictModule(body, in_keys=["observation"], out_keys=["loc", "scale"]),
            in_keys=["loc", "scale"],
            distribution_class=IndependentNormal,
            return_log_prob=True,
        )
