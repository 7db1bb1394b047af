"""Experience of a collector; a resumed run goes on where it was, in the middle of episodes.

collecting = ResumableCollector(parts, env, actor, frames_per_batch=2048)
data = collecting.next()                        # (N, T), as TorchRL's collectors deliver it
"""

import atexit
import logging
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torchrl.collectors import BaseCollector, MultiCollector

from envs.torch_env import RowsEnv
from sim2real.learning.algorithms.base import Components
from sim2real.learning.algorithms.returns import EpisodeReturnTracker
from sim2real.learning.environment import SerializableEnv
from sim2real.learning.trained import TrainedPolicy, drop_per_row_state, from_actor
from sim2real.learning.transforms import affine, reward_scale
from sim2real.runs.errors import CheckpointError

log = logging.getLogger(__name__)
PATIENCE = 5.0  # s that a collector's processes have to end


class ResumableCollector:
    """A collector over an environment, and the returns of its episodes.

    Args:
        parts: its collector.
        env: where.
        actor: who acts.
        frames_per_batch: environment steps of a batch, in all rows.
    """

    def __init__(
        self,
        parts: Components,
        env: SerializableEnv,
        actor: TensorDictModuleBase,
        frames_per_batch: int,
    ) -> None:
        self.env, self._environment = env, parts.environment
        make = parts.part("collector")
        self._collector = make(env, actor, frames_per_batch=frames_per_batch, total_frames=-1)
        here = not isinstance(self._collector, MultiCollector)  # or its episodes are elsewhere
        self._rows = env.base_env if here and isinstance(env.base_env, RowsEnv) else None
        self._batches = iter(self._collector)
        self._end = weakref.finalize(self, _shut_down, self._collector)
        atexit.register(self._end)  # before Python waits for processes that were not ended
        self.returns = EpisodeReturnTracker(env.batch_size[0])

    @property
    def in_rows(self) -> bool:
        """Whether episodes run in rows of this process, which can go back into them."""
        return self._rows is not None

    def close(self) -> None:
        """End the collector and its environments, with all their processes; twice is once."""
        self._end()
        atexit.unregister(self._end)

    def next(self) -> TensorDictBase:
        """Return the next batch of steps, (N, T)."""
        data = next(self._batches)
        self.returns.note(data)
        return data

    def trained(self, policy: Any, frames: int) -> TrainedPolicy:
        """Return a policy as it acts behind the transforms of now; see `from_actor`."""
        statistics = self.env.transform.state_dict()
        shown, unit = affine(self.env), reward_scale(self.env)
        return from_actor(policy, self._environment, statistics, frames, shown, unit)

    def state_dict(self) -> dict[str, Any]:
        """Return all that the next batches depend on besides the policy."""
        return {
            "rows": self.env.batch_size[0],
            "frames": self._collector._frames,  # the first may be of random actions
            "transforms": _plain(self.env.transform.state_dict()),
            "episodes": None if self._rows is None else self._rows.episodes(),
            "carrier": None if self._rows is None else _tree(self._collector._carrier),
            "returns": self.returns.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take over a state; episodes that cannot be replayed restart.

        Raises:
            CheckpointError: for a state of other transforms or another number of rows.
        """
        here = self.env.batch_size[0]
        if state["rows"] != here:
            raise CheckpointError(
                f"checkpoint: it has {state['rows']} rows, this run {here}; set "
                f"algorithm.num_rows={state['rows']}"
            )
        rows, episodes = self._rows, state["episodes"]
        anew = rows is None or episodes is None
        self._load(state["transforms"], drop_per_row_state if anew else dict)
        self._collector._frames = state["frames"]
        self.returns.load_state_dict(state["returns"])
        if rows is None or episodes is None:
            self._start_anew()
            return
        rows.resume(episodes)
        carrier = TensorDict(state["carrier"], self.env.batch_size, device=self.env.device)
        self._collector._carrier = carrier

    def _start_anew(self) -> None:
        """Begin an episode in every row, from other seeds than those before the checkpoint."""
        self.returns.restart()
        seeds = np.random.SeedSequence([self.env.seed, self._collector._frames])
        self._collector.set_seed(int(seeds.generate_state(1)[0]) % 2**31)
        self._collector.reset()
        log.warning(
            "%s in %s cannot resume its episodes; the resumed run starts new ones",
            type(self.env.base_env).__name__,
            type(self._collector).__name__,
        )

    def load_statistics(self, state: dict[str, Any]) -> None:
        """Take over what the transforms know of all rows, to act.

        Raises:
            CheckpointError: for a state of other transforms.
        """
        self._load(state["transforms"], drop_per_row_state)

    def _load(self, transforms: dict[str, Any], part: Callable[..., dict[str, Any]] = dict) -> None:
        """Load a part of a state of the same transforms."""
        there, here = part(transforms), part(self.env.transform.state_dict())
        if there.keys() != here.keys():
            names = dict(enumerate(self._environment.transforms))
            odd = [names.get(_place(key), key) for key in here if key not in there]
            lost = [f"transform {_place(key)}" for key in there if key not in here]
            raise CheckpointError(
                "checkpoint: the transforms differ between the checkpoint and this run; only this "
                f"run has {', '.join(odd) or 'none'}, only the checkpoint has "
                f"{', '.join(lost) or 'none'}; remove transforms= and algorithm=, or give the "
                "transforms= of its training"
            )
        self.env.transform.load_state_dict(there, strict=part is dict)


def _place(key: str) -> int:
    """Return which transform of the chain, from 0, an entry of its state belongs to."""
    return int(key.split(".")[1])


def _shut_down(collector: BaseCollector) -> None:
    """Shut a collector down; one that was abandoned in an iteration may not answer any more."""
    collector.shutdown(timeout=PATIENCE, raise_on_error=False)


def _plain(state: dict[str, Any]) -> dict[str, Any]:
    return {name: v.clone() if hasattr(v, "clone") else v for name, v in state.items()}


def _tree(data: TensorDictBase) -> dict[str, Any]:
    """Return a tensordict as nested dicts of tensors."""
    return data.detach().clone().to_dict()
