"""TorchRL's collector, faster: the same steps without what TorchRL checks and copies at each.

    collector = FastCollector(env, actor, frames_per_batch=2048)
    batch = next(iter(collector))                     # a TensorDict (N, T), as Collector yields it

With 16 small robots the physics of a step takes less time than the general machinery around it:
tensordicts of tensordicts are merged by masks, entries validated, casts looked for. Here a step
calls what does something, the policy, the world and its transforms, and keeps what they return.
The episodes in progress stand where `Collector` has them, in `_carrier` and in the environment.
"""

from collections.abc import Sequence
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.collectors import Collector
from torchrl.envs import Compose, Transform, TransformedEnv
from torchrl.envs.utils import set_exploration_type

from envs.torch_env import RowsEnv
from sim2real.learning.collectors.acting import acting
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor
SUPPORTED: dict[str, tuple[Any, ...]] = {  # the values that it knows of options it has in part
    "interruptor": (None,),
    "compact_obs": (False,),
    "compile_policy": (None, False),
    "cudagraph_policy": (None, False),
    "extend_buffer": (True,),
}


class FastCollector(Collector):
    """`Collector` in this process, over an environment with one batch dimension.

    Args:
        create_env_fn: an environment, or what makes it.
        policy: a tensordict module. An actor of a Gaussian is called without TorchRL's machinery;
            any other as it is.
        options: those of `Collector`.

    Raises:
        Sim2RealError: for options that it does not have, an environment of another batch shape or
            with nested ends, or a policy on another device; `Collector` takes those.
    """

    def __init__(self, create_env_fn: Any, policy: Any = None, **options: Any) -> None:
        for name, value in options.items():
            if name in SUPPORTED and value not in SUPPORTED[name]:
                _refuse(f"{name}={value!r}")
        super().__init__(create_env_fn, policy, **options)
        if self.env.ndim != 1 or self.env.reset_keys != ["_reset"]:
            _refuse(f"an environment of batch size {tuple(self.env.batch_size)}, or nested ends")
        if self.policy_device not in (None, self.env.device):
            _refuse(f"a policy on {self.policy_device} for an environment on {self.env.device}")
        env = self.env
        self._transformed = isinstance(env, TransformedEnv)
        self._base = env.base_env if isinstance(env, TransformedEnv) else env
        self._transform: Any = Compose([])
        if isinstance(env, TransformedEnv):
            self._transform = env.transform
        self._acts_through = any(_changes_actions(one) for one in self._transform)
        for one in self._transform:
            if type(one)._post_step_mdp_hooks is not Transform._post_step_mdp_hooks:
                _refuse(f"transforms that act between steps, as {type(one).__name__} does")
        self._whole = isinstance(self._base, RowsEnv)  # its ends are never incomplete
        whole: Any = self._wrapped_policy
        self._act = acting(whole)
        self._unsaid = self._new({})  # what a policy writes, where actions are random instead
        if self._use_buffers:
            said = set(self._policy_output_keys) - set(env.action_keys)
            self._unsaid = self._final_rollout[..., 0].select(*said).clone()

    @torch.no_grad()
    def rollout(self) -> TensorDictBase:
        """Step on from where the last batch ended."""
        if self.pre_collect_hook is not None:
            self.pre_collect_hook()
        if self.reset_at_each_iter:
            self._carrier.update(self.env.reset())
            self._start_new_trajectories()
        frames = []
        with set_exploration_type(self.exploration_type):
            for _ in range(self.frames_per_batch):
                frames.append(self._step())
        batch = _stacked(frames, self.env.ndim)
        batch.refine_names(..., "time")
        if self.storing_device is not None:
            batch = batch.to(self.storing_device)
        return self._maybe_set_truncated(batch)

    def _step(self) -> TensorDictBase:
        """Take a step in every row; return what the step was, with what came after it."""
        frame = self._carrier
        if self._should_use_random_frames():
            self.env.rand_action(frame)
            frame.update(self._unsaid)
        else:
            self._act(frame)
        chosen: Any = frame.pop("next", None)  # what a policy with a memory remembers
        given = self._transform.inv(frame) if self._acts_through else frame
        after = self._completed(self._base._step(given))
        if chosen is not None:
            after.update(chosen.exclude(*after.keys(True, True)))
        after = self._transform._step(frame, after)
        self._carrier = self._following(frame, after)
        return frame.set("next", after)

    def _completed(self, tensordict: TensorDictBase) -> TensorDictBase:
        if not self._whole:
            self._base._complete_done(self._base.full_done_spec, tensordict)
        return tensordict

    def _following(self, frame: TensorDictBase, after: TensorDictBase) -> TensorDictBase:
        """Return the start of the next step: in rows that ended, that of a new episode."""
        rewards = self.env.reward_keys
        kept = {key: x for key, x in after.items() if key not in rewards}
        nested = {key: x.copy() for key, x in kept.items() if isinstance(x, TensorDictBase)}
        start = self._new(kept | nested)
        done = after.get("done")
        ended = bool(done.any())
        if ended:
            start = self._restarted(start, done)
        if self.track_traj_ids:
            start.set("collector", frame.get("collector").copy())
            if ended:
                self._number(start, done)
        return start

    def _restarted(self, start: TensorDictBase, done: Tensor) -> TensorDictBase:
        if not self._transformed:
            return self.env.maybe_reset(start)
        given = self._transform._reset_env_preprocess(self._new({"_reset": done}))
        fresh = self._completed(self._base._reset(given))
        fresh = self._transform._reset(self._new({"_reset": done}), fresh)
        return self._merged(fresh, start, done[:, 0])

    def _merged(self, fresh: TensorDictBase, old: TensorDictBase, mask: Tensor) -> TensorDictBase:
        """Return entries of `fresh` in the rows of the mask (N,), and of `old` in the others."""
        out: dict[str, Any] = dict(old.items())
        for key, x in fresh.items():
            if isinstance(x, TensorDictBase):
                out[key] = self._merged(x, old.get(key), mask)
            elif key != "_reset":
                out[key] = torch.where(mask.view(-1, *[1] * (x.ndim - 1)), x, old.get(key))
        return self._new(out)

    def _number(self, start: TensorDictBase, done: Tensor) -> None:
        """Number the episodes that begin."""
        collector, mask = start.get("collector"), done[:, 0]
        ids = collector.get("traj_ids")
        new = self._traj_pool.get_traj_and_increment(int(mask.sum()), device=ids.device)
        collector.set("traj_ids", ids.masked_scatter(mask.to(ids.device), new))

    def _new(self, data: dict[str, Any]) -> TensorDictBase:
        """Return a tensordict without its constructor's checks, which cost much here."""
        return TensorDict._new_unsafe(data, batch_size=self.env.batch_size, device=self.env.device)


def _changes_actions(transform: Transform) -> bool:
    return bool(transform.in_keys_inv) or type(transform)._inv_call is not Transform._inv_call


def _stacked(frames: Sequence[TensorDictBase], dim: int) -> TensorDict:
    """Return the frames along a further, last batch dimension."""
    first, data = frames[0], {}
    for key, value in first.items():
        parts = [frame.get(key) for frame in frames]
        nested = isinstance(value, TensorDictBase)
        data[key] = _stacked(parts, dim) if nested else torch.stack(parts, dim)
    return TensorDict._new_unsafe(data, batch_size=torch.Size([*first.batch_size, len(frames)]))


def _refuse(what: str) -> None:
    raise Sim2RealError(f"collector=fast does not support {what}; use collector=sync")
