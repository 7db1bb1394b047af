"""Settings of runs that were made at different times are compared by what they mean."""

from sim2real.runs.settings import decisive


def test_a_stored_draw_of_a_class_is_that_of_its_name() -> None:
    """Class or standard name, defaults written out or not: one robot is one setting."""
    mass = {"_target_": "envs.effects.LinkMass", "where": "torso", "how": "add"}
    friction = {"_target_": "envs.effects.GroundFriction", "friction_mode": "contact"}
    law = {"_target_": "envs.randomization.Draw", "distribution": "uniform", "low": 1, "high": 2}
    draws = [{**law, "effect": mass}, {**law, "effect": friction}]
    old = {"params": {"_target_": "envs.randomization.Randomization", "draws": draws}}
    draws = [
        {"effect": "link_mass", "where": "torso", "low": 1, "high": 2},
        {"effect": "ground_friction", "low": 1, "high": 2},
    ]
    new = {"params": {**old["params"], "per": "reset", "draws": draws}, "seed": 3}
    assert decisive(old) == decisive(new)
    draws[0]["how"] = "scale"
    assert decisive(old) != decisive(new)


def test_what_is_made_later_need_not_say_so() -> None:
    """A mark that an argument's type makes needless is no other setting; a value is."""
    tanh = {"_target_": "torch.nn.Tanh"}
    old = {"policy": {"actor": {"num_cells": [64], "activation_class": tanh | {"_partial_": True}}}}
    new = {"policy": {"actor": {"num_cells": [64], "activation_class": tanh}}}
    assert decisive(old) == decisive(new)
    assert decisive(old) != decisive({"policy": {"actor": {"num_cells": [32]}}})
