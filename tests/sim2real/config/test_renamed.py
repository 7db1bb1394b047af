"""Names that were renamed: saved runs and users' own code still find what they mean."""

import pytest

import sim2real
from sim2real.config.renamed import MOVED_TARGETS
from sim2real.config.targets import build, import_target


@pytest.mark.parametrize(("old", "new"), MOVED_TARGETS.items())
def test_a_class_of_a_saved_run_is_found_under_its_present_name(old: str, new: str) -> None:
    """Configurations are data; what they name may have moved since they were written."""
    assert import_target(old, "saved") is import_target(new, "saved")


def test_a_saved_tree_builds_what_it_described() -> None:
    """The same object comes of the old name and of the new one."""
    argument = {
        "_target_": "sim2real.learning.adapt.HillClimb",
        "queries": 7,
        "parallel": 7,
        "sigma": 0.1,
    }
    trees = [
        {"_target_": f"sim2real.learning.adapt.{name}", "operator": {**argument, "mode": "batch"}}
        for name in ("Noisy", "NoisyReturns")
    ]
    first, second = (build(tree, "adapt") for tree in trees)
    assert type(first) is type(second)
    assert first.operator.sigma == second.operator.sigma == 0.1


def test_an_old_public_name_is_taken_with_a_warning() -> None:
    """It stays for one minor release."""
    with pytest.warns(DeprecationWarning, match="TrainedPolicy"):
        assert sim2real.Trained is sim2real.TrainedPolicy
