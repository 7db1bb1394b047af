"""Policies of other libraries: their files fit their descriptions and their tasks."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks import contract
from benchmarks.contract_walk import Fault, stacked
from benchmarks.policies.tasks import POLICIES, down
from envs.simulation import Simulation
from sim2real.diagnosis.contract.description import History

pytestmark = pytest.mark.slow  # trainings and walks: a minute together


@pytest.mark.parametrize("library", POLICIES)
def test_policy_description_and_task_fit(library: str) -> None:
    """As many numbers in the task's observation as described, and the policy's actions are used."""
    pytest.importorskip("onnxruntime")
    one = POLICIES[library]
    assert b"site-packages" not in one.file.read_bytes()  # nothing of the machine that trained it
    task = one.task()
    model = task.spec().compile()
    about = one.about([model.actuator(i).name for i in range(model.nu)])
    rows = Simulation(task, 2, threads=1)
    frame = rows.reset(np.arange(2), rows.space.points(2), np.zeros(2, np.uint64))
    seen = np.tile(frame, about.history.length)
    assert seen.shape == (2, about.size) and frame.shape == (2, about.frame_size)
    action = one.actor()(seen)
    assert action.shape == (2, about.action.size)
    assert np.isfinite(rows.step(None, action).reward).all()


def test_a_sound_walk_of_each_has_no_finding() -> None:
    """And a fault of the first one is named."""
    pytest.importorskip("onnxruntime")
    for number in range(len(POLICIES)):
        told = contract.foreign(3, number, faulty=False)
        assert (told["key"], told["found"]) == ([], [])
    told = contract.foreign(8, 0, faulty=True)
    assert told["key"] and told["named"]


def test_gravity_is_that_of_the_rotation() -> None:
    """The formula of quaternions against scipy's."""
    turn = Rotation.random(5, rng=np.random.default_rng(0))
    made = down(turn.as_quat(scalar_first=True))
    assert np.allclose(made, turn.inv().apply([0, 0, -1]))


def test_a_history_is_stacked_as_the_fault_has_it() -> None:
    """The described order, and the other one."""
    about = POLICIES["stable_baselines3"].about(["hip", "knee"])
    assert about.normalizer is not None
    mean, std = about.normalizer
    frames = [np.full(about.frame_size, float(k)) for k in range(5)]
    right = stacked(about, [], frames) * std + mean
    assert np.allclose(right[:: about.frame_size], [4, 3, 2])
    turned = Fault(("observation", "history_order", "history"),
                   stack=History(3, "frame", "oldest_first"))  # fmt: skip
    wrong = stacked(about, [turned], frames) * std + mean
    assert np.allclose(wrong[:: about.frame_size], [2, 3, 4])
