"""conf/ as documentation and as configuration: comments that tell, choices that compose."""

import re
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from sim2real.config.catalogue import CONF, groups, options, summary
from sim2real.config.compose import compose, instantiate
from sim2real.config.targets import build
from sim2real.learning.algorithms.base import build as make_algorithm

FILES = sorted(CONF.rglob("*.yaml"))
KEY = re.compile(r"^(?P<indent>[ -]*)(?P<key>[A-Za-z_][\w.]*|override /\w+):(?P<value>.*)$")
APART = ("run", "experiment")  # they choose of other groups
ALONE = ("algorithm", "transforms", "buffer", "robot", "exam", "identify", "bayrn")
CHOICES = [(g, o) for g in groups() if g in ALONE for o in options(g)]
TOGETHER = [g for g in groups() if g not in (*APART, *ALONE)]
LATER = ("blindcheck_drake", "pixels_single", "pixels_stack4_lr1e4")  # needs Drake; like others
FILLERS = {"the", "what", "its", "which"}


def repeating(path: Path) -> list[str]:
    """Return the keys of a YAML file whose comment has no other words than they have."""
    found = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        match = KEY.match(line)
        comment = match["value"].partition(" #")[2] if match else ""
        if match and comment.strip() and words(comment) <= words(match["key"]) | FILLERS:
            found.append(f"{path.name}:{number} {match['key']}")
    return found


def words(text: str) -> set[str]:
    """Return the words of a key or a comment, in the singular, and the signs of a comment."""
    found = re.findall(r"[^\W\d_]+|[^\w\s]+|\d+", text.lower())
    return {word.removesuffix("s") if len(word) > 3 else word for word in found}


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(CONF)))
def test_comments_say_what_keys_do_not(path: Path) -> None:
    """The first line says what the file is; no comment says its key once more."""
    assert repeating(path) == []
    assert summary(path)


def test_a_comment_that_repeats_its_key_is_found(tmp_path: Path) -> None:
    """Units, ranges and reasons are none; neither is a key without a comment."""
    file = tmp_path / "some.yaml"
    file.write_text(
        "task: 1  # the task\nmax_steps: 2  # the steps\nlow: 3  # m, at least\nhigh: 4\n"
    )
    assert [line.split()[-1] for line in repeating(file)] == ["task", "max_steps"]


@cache
def experiment(name: str) -> dict[str, Any]:
    """Return an experiment, composed; it takes a third of a second."""
    return compose([f"+experiment={name}"])


@pytest.mark.parametrize("name", options("experiment"))
def test_experiments_compose(name: str) -> None:
    """Each experiment composes and fits the signatures of what it names."""
    tree = experiment(name)
    assert tree["iterations"] or tree["frames"]


@pytest.mark.parametrize(("group", "option"), CHOICES)
def test_choices_compose(group: str, option: str) -> None:
    """Each choice of each group composes with the defaults of the rest and fits its signatures."""
    verb = {"robot": ["run=record"], "exam": ["run=blindcheck"]}.get(group, [])  # else train
    verb = ["run=identify", "log=run.csv"] if group == "identify" else verb
    verb = ["run=improve"] if group == "bayrn" else verb
    words = {"transforms": ["algorithm=ppo"], "buffer": ["algorithm=ppo"]}.get(group, [])
    tree = compose([*verb, *words, f"{group}={option}"])
    name = {"robot": "name", "transforms": "randomize_params"}.get(group, "_target_")
    assert tree[group] is None or tree[group][name]


@pytest.mark.parametrize("number", range(max(len(options(g)) for g in TOGETHER)))
def test_choices_compose_together(number: int) -> None:
    """Each choice of each other group composes beside one of all the rest, and fits likewise."""
    chosen = {g: options(g)[number % len(options(g))] for g in TOGETHER}
    tree = compose(["algorithm=ppo", *(f"{g}={option}" for g, option in chosen.items())])
    assert all(tree[group] is None or tree[group]["_target_"] for group in TOGETHER)


def alone(name: str) -> Any:
    """Return an experiment as a parameter; those of LATER wait for the long suite."""
    marks = [pytest.mark.slow] if name in LATER else []
    return pytest.param(name, marks=marks)


@pytest.mark.parametrize("name", [alone(name) for name in options("experiment")])
def test_experiments_can_be_built(name: str, tmp_path: Path) -> None:
    """What an experiment names can be made, and its tasks fit its environment."""
    tree = deepcopy(experiment(name))
    trains = tree["run"]["_target_"] == "sim2real.verbs.train.run"
    if trains:
        tree["logger"] = experiment("smoke")["logger"]  # no page is opened
    if name == "blindcheck_drake":
        pytest.importorskip("pydrake", reason="needs Drake: pip install 'sim2real[engines]'")
    verb, arguments = instantiate(tree, tmp_path)
    assert callable(verb)
    if not trains:
        return
    parts = arguments["parts"]
    assert make_algorithm(arguments["algorithm"], parts).iteration == 0  # its parts go together
    environment = parts.environment
    rows = environment.base_rows(2)
    environment.tasks.check(rows.space)
    if hasattr(arguments.get("eval"), "grid"):
        assert arguments["eval"].grid.values(rows.space).shape[1] == rows.space.size


def test_the_hopper_grid_is_that_of_the_literature() -> None:
    """Masses from 0.5 to 11.5 kg in 12 steps, frictions from 0.1 to 2.9 in 15."""
    grid = build(compose(["eval=grid_hopper"])["eval"], "eval").grid
    mass, friction = (axis.values for axis in grid.axes)
    assert (len(mass), mass[0], mass[-1], round(mass[1] - mass[0], 9)) == (12, 0.5, 11.5, 1.0)
    assert (len(friction), friction[0], friction[-1], round(friction[1] - friction[0], 9)) == (
        15,
        0.1,
        2.9,
        0.2,
    )


def test_three_episodes_of_adaptation() -> None:
    """The main job adapts in three episodes, the unchanged policy's own counted."""
    assert build(compose(["+experiment=esmaml"])["adapt"], "adapt").episodes == 3


def test_fixed_is_one_robot() -> None:
    """`params=fixed` draws 6 kg and friction 2 and nothing else."""
    draws = build(compose(["params=fixed"])["params"], "params").draws
    assert [(d.effect.name, d.low, d.high) for d in draws] == [
        ("link_mass", 6, 6),
        ("ground_friction", 2, 2),
    ]


def test_the_defaults_leave_room_for_an_experiment() -> None:
    """An entry for `experiment` in the defaults list would make +experiment=NAME an error."""
    root = yaml.safe_load((CONF / "config.yaml").read_text())
    assert not any("experiment" in str(entry) for entry in root["defaults"])


def test_a_saved_tree_with_classes_in_place_of_names_still_builds() -> None:
    """`config.yaml` of a run made before draws took standard names draws the same robots."""
    mass = {"_target_": "envs.effects.LinkMass", "where": "torso", "how": "set"}
    draw = {"_target_": "envs.randomization.Draw", "effect": mass, "low": 6.0, "high": 6.0}
    old = {"_target_": "envs.randomization.Randomization", "per": "reset", "draws": [draw]}
    new = build(compose(["params=fixed"])["params"], "params").draws[0]
    (made,) = build(old, "params").draws
    assert (made.effect.label(), made.effect.how, made.reach) == (
        new.effect.label(),
        new.effect.how,
        new.reach,
    )
