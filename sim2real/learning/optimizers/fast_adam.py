"""torch's Adam, faster for a dozen small tensors: one step for the vector that they form.

    optimizer = FastAdam(policy.parameters(), lr=3e-4, eps=1e-5)
    optimizer.step()

The parameters and both moments are kept side by side in memory (`FlatParameters`). Gradients that
are, too, as those of `FastClipPPOLoss`, are taken as they lie; others are copied first. The state
is that of `torch.optim.Adam`, either of which goes on with that of the other.
"""

from collections.abc import Callable, Iterable
from typing import Any

import torch
from torch import nn

from sim2real.learning.modules.flat import FlatParameters
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor
SUPPORTED: dict[str, tuple[Any, ...]] = {  # the values that it knows of options it has in part
    "weight_decay": (0,),
    "amsgrad": (False,),
    "maximize": (False,),
    "capturable": (False,),
    "differentiable": (False,),
    "decoupled_weight_decay": (False,),
}
MOMENTS = ("exp_avg", "exp_avg_sq")  # the names of the first and second in torch's state


class FastAdam(torch.optim.Adam):
    """`torch.optim.Adam` (Kingma and Ba 2015) of parameters of one dtype on one device.

    Args:
        params: the parameters, in one group.
        options: those of `torch.optim.Adam`.

    Raises:
        Sim2RealError: for options that it does not have, or parameters that make no vector;
            `torch.optim.Adam` takes those.
    """

    def __init__(self, params: Iterable[nn.Parameter], **options: Any) -> None:
        for name, value in options.items():
            if name in SUPPORTED and value not in SUPPORTED[name]:
                _refuse(f"{name}={value!r}")
        given = list(params)
        if any(isinstance(p, dict) for p in given):
            _refuse("groups of parameters")
        if len({(p.dtype, p.device) for p in given}) > 1:
            _refuse("parameters of several dtypes or devices")
        super().__init__(given, **options)
        self._flat = FlatParameters(given)
        self._moments: dict[str, tuple[Tensor, list[Tensor]]] = {}  # as vector, and its parts
        self._seen: Any = None  # the states as they were when they were looked up
        self._each: list[dict[str, Any]] = []

    @torch.no_grad()
    def step(self, closure: Callable[[], Any] | None = None) -> Any:
        """Take a step; a closure that computes the loss is called first."""
        loss = None
        if closure is not None:
            with torch.enable_grad():
                loss = closure()
        parameters = self._flat.parameters
        gradient = self._flat.gradient()
        lacking = gradient is None and any(p.grad is None for p in parameters)
        if lacking or not self._together():
            self._part()  # those without a gradient do not move, and count fewer steps
            super().step()
            return loss
        if gradient is None:
            self._flat.renew()
            gradient = torch.cat([p.grad.flatten() for p in parameters if p.grad is not None])
        self._move(self._flat.vector, gradient)
        return loss

    def _move(self, vector: Tensor, gradient: Tensor) -> None:
        group, step = self.param_groups[0], self._states()[0]["step"]
        first, second = (self._moment(name) for name in MOMENTS)
        step.add_(1)
        torch._fused_adam_(  # pyright: ignore[reportPrivateImportUsage]
            [vector],
            [gradient],
            [first],
            [second],
            [],
            [step],
            lr=float(group["lr"]),
            beta1=group["betas"][0],
            beta2=group["betas"][1],
            weight_decay=0.0,
            eps=group["eps"],
            amsgrad=False,
            maximize=False,
        )

    def _states(self) -> list[dict[str, Any]]:
        """Return the state of each parameter, looked up again where another was loaded."""
        if self.state is not self._seen:
            self._seen, self._each = self.state, [self.state[p] for p in self._flat.parameters]
        return self._each

    def _together(self) -> bool:
        """Say whether all parameters have made as many steps; if so, they share one count."""
        states = self._states()
        step = states[0].get("step")
        if step is not None and all(state.get("step") is step for state in states):
            return True
        counts = {float(state.get("step", 0.0)) for state in states}
        if len(counts) > 1:
            return False
        step = torch.tensor(counts.pop(), device=self._flat.parameters[0].device)
        for state in states:
            state["step"] = step
        return True

    def _part(self) -> None:
        """Give each parameter its own step count."""
        for state in self.state.values():
            if "step" in state:
                state["step"] = state["step"].clone()

    def _moment(self, name: str) -> Tensor:
        """Return a moment of all parameters, (P,), of which each parameter's is a view."""
        states = self._states()
        vector, parts = self._moments.get(name, (torch.empty(0), []))
        if parts and all(state[name] is part for state, part in zip(states, parts, strict=True)):
            return vector
        if name in states[0]:
            vector = torch.cat([state[name].flatten() for state in states])
        else:
            vector = torch.zeros_like(self._flat.vector)
        parts = self._flat.split(vector)
        for state, part in zip(states, parts, strict=True):
            state[name] = part
        self._moments[name] = vector, parts
        return vector

    def zero_grad(self, set_to_none: bool = True) -> None:
        """Forget the gradients."""
        if not set_to_none:
            super().zero_grad(set_to_none=False)
        for p in self._flat.parameters if set_to_none else ():
            p.grad = None


def _refuse(what: str) -> None:
    raise Sim2RealError(f"optimizer=fast_adam has no {what}; use optimizer=adam")
