"""Descriptions of a policy's interface: what the ready-made ones say, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from sim2real.diagnosis.contract.description import READY, Description, read_description
from sim2real.diagnosis.contract.terms import ContractError

JOINTS = [f"{leg}_{part}" for leg in ("FL", "FR", "RL", "RR") for part in ("hip", "thigh", "calf")]
POSE = {name: 0.1 * i for i, name in enumerate(JOINTS)}
SMALL = {
    "rate": 50.0,
    "observation": [{"term": "joint_position"}, {"term": "gyro", "scale": 0.25}],
    "default_pose": [0.1, 0.2],
    "action": {"scale": 0.25},
}


def of(tmp_path: Path, given: object, joints: tuple[str, ...] = ("a", "b")) -> Description:
    """Read a description that is written down first."""
    file = tmp_path / "OBS.yaml"
    file.write_text(given if isinstance(given, str) else yaml.safe_dump(given))
    return read_description(file, joints)


@pytest.mark.parametrize(
    ("name", "size", "scale"),
    [("legged_gym", 48, 0.25), ("isaac_lab", 48, 0.25), ("mjlab", 48, 0.5)],
)
def test_the_common_stacks_are_ready_made(tmp_path, name, size, scale):
    """A quadruped's 12 joints make 48 numbers in each; the pose comes from the user's file."""
    about = of(tmp_path, {"base": name, "joints": JOINTS, "default_pose": POSE})
    assert (about.size, about.action.size) == (size, 12)
    assert about.action.scale == pytest.approx(np.full(12, scale))
    assert about.action.offset == pytest.approx(0.1 * np.arange(12))


def test_every_ready_made_file_can_be_read(tmp_path):
    """Ours need nothing more; those of other stacks need a pose and say so."""
    for name in READY:
        if name in ("quad8", "quad12", "hopper2", "follow", "bench1"):
            assert read_description(name, JOINTS[:6]).size > 0
            continue
        with pytest.raises(ContractError, match="default_pose"):
            read_description(name, JOINTS)


def test_keys_beside_a_base_replace_its_own(tmp_path):
    """One key of `action` can be changed without writing the others again."""
    base = {"base": "legged_gym", "joints": JOINTS, "default_pose": POSE}
    about = of(tmp_path, {**base, "action": {"scale": 0.5}, "history": {"length": 3}})
    assert about.action.scale[0] == 0.5
    assert about.action.clip == 100.0
    assert about.size == 3 * 48


def test_joints_of_the_log_are_taken_where_none_are_named(tmp_path):
    """Terms of joints have one number for each of the log's joints, in its order."""
    about = of(tmp_path, SMALL)
    assert about.joints == ("a", "b")
    assert [term.size for term in about.terms] == [2, 3]
    assert about.terms[1].elements == ("x", "y", "z")


def changed(**keys: object) -> dict[str, object]:
    """Return the small description with other keys."""
    return {**SMALL, **keys}


BAD = {
    "an unknown term": (changed(observation=[{"term": "gyros"}]), "did you mean 'gyro'"),
    "an unknown frame": (
        changed(observation=[{"term": "gyro", "frame": "wrld"}]),
        "did you mean 'world'",
    ),
    "an unknown key": (changed(rates=5), "did you mean 'rate'"),
    "an unknown key of a term": (
        changed(observation=[{"term": "gyro", "order": "wxyz"}]),
        "key 'order' is unknown",
    ),
    "no terms": (changed(observation=[]), "must be a list of terms"),
    "scale 0": (changed(observation=[{"term": "gyro", "scale": 0.0}]), "other than 0"),
    "too few scales": (changed(observation=[{"term": "gyro", "scale": [1, 2]}]), "2 numbers for 3"),
    "a joint that is not there": (
        changed(observation=[{"term": "joint_velocity", "joints": ["c"]}]),
        "joint 'c' is unknown",
    ),
    "a pose in degrees": (changed(default_pose=[10.0, 45.0]), "within a turn"),
    "a pose of three": (changed(default_pose=[0.1, 0.2, 0.3]), "3 numbers for 2"),
    "no pose": (changed(default_pose=None), "default_pose"),
    "no rate": (changed(rate=None), "rate: None"),
    "a history of none": (changed(history={"length": 0}), "from 1 to 200"),
    "an unknown order": (changed(history={"order": "oldest"}), "oldest_first"),
    "a phase without clock": (changed(observation=[{"term": "phase"}]), "frequency"),
    "a command of no size": (changed(observation=[{"term": "command"}]), "size None"),
    "a normalizer of one": (changed(normalizer={"mean": [0.0], "std": [1.0]}), "1 numbers for 5"),
    "an unknown base": (changed(base="leged_gym"), "did you mean 'legged_gym'"),
    "a list": ("[1, 2]", "expected a mapping"),
    "invalid YAML": ("a: [", "invalid YAML"),
    "a NaN": (changed(action={"scale": float("nan")}), "other than 0"),
}


@pytest.mark.parametrize("what", BAD)
def test_bad_input_is_refused_with_a_sentence(tmp_path, what):
    """The sentence names the file and what is allowed."""
    given, words = BAD[what]
    with pytest.raises(ContractError, match=r"OBS\.yaml") as refused:
        of(tmp_path, given)
    assert words in str(refused.value)


def test_a_description_that_is_not_there():
    """The nearest ready-made one is offered."""
    with pytest.raises(ContractError, match="did you mean 'quad8'"):
        read_description("quad9", ["a"])
