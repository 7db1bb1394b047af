"""The policy in NumPy is the perceptron that it says it is."""

import numpy as np
import pytest

from hardware.exported import ExportedPolicy, PolicyError

ARRAYS = {
    "mean": np.array([1.0, -1.0]), "std": np.array([2.0, 0.5]), "low": np.array([-0.5]),
    "high": np.array([1.5]), "weight_0": np.array([[1.0, -2.0, 0.5], [0.0, 1.0, 3.0]], np.float32),
    "bias_0": np.array([0.1, 0.0, -0.2], np.float32),
    "weight_1": np.array([[1.0], [-1.0], [0.5]], np.float32), "bias_1": np.array([0.3], np.float32),
}  # fmt: skip
SEEN = np.array([[1.5, -0.75], [1.0, -1.0], [40.0, 3.0]])


def policy(activation: str, squash: str, **changes: object) -> ExportedPolicy:
    """Return a policy of two observations and one action."""
    facts = {
        "schema": 1, "robot": "bench1", "rate": 50.0, "joints": ["hinge"],
        "observation": {"names": ["angle", "speed"]}, "layers": 2, "activation": activation,
        "squash": squash, "golden": {"observation": SEEN.tolist(), "action": [[0.0]] * 3},
    }  # fmt: skip
    return ExportedPolicy(facts | changes, ARRAYS)


@pytest.mark.parametrize("activation", ["tanh", "relu"])
@pytest.mark.parametrize("squash", ["none", "tanh", "clip"])
def test_the_formula(activation, squash):
    """Normalize, layer, nonlinearity, layer, limits: by hand for three observations."""
    bend = np.tanh if activation == "tanh" else lambda x: np.maximum(x, 0)
    x = (SEEN - ARRAYS["mean"]) / ARRAYS["std"]
    y = bend(x @ ARRAYS["weight_0"] + ARRAYS["bias_0"]) @ ARRAYS["weight_1"] + ARRAYS["bias_1"]
    limit = {"none": lambda y: y, "tanh": lambda y: 0.5 + np.tanh(y), "clip": None}[squash]
    wanted = np.clip(y, -0.5, 1.5) if limit is None else limit(y)
    np.testing.assert_allclose(policy(activation, squash)(SEEN), wanted, rtol=1e-6)
    np.testing.assert_allclose(policy(activation, squash)(SEEN[0]), wanted[0], rtol=1e-6)


def test_what_makes_no_policy_is_refused():
    """Unknown nonlinearities, layers that do not fit, another schema, actions that differ."""
    with pytest.raises(PolicyError, match="sigmoid and clip, are not a policy"):
        policy("sigmoid", "clip")
    with pytest.raises(PolicyError, match=r"layers of \[2\] inputs"):
        policy("tanh", "clip", layers=1)
    with pytest.raises(PolicyError, match="schema None"):
        policy("tanh", "clip", schema=None)
    with pytest.raises(PolicyError, match="actions are off by"):
        policy("tanh", "clip").check()
