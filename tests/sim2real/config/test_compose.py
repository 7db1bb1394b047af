"""The command line's answers: a sentence with the nearest match, before torch is imported."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from hydra import initialize_config_dir
from hydra.core.global_hydra import GlobalHydra

from sim2real.config.catalogue import CONF
from sim2real.config.compose import compose, device, save, sweep_jobs
from sim2real.config.folders import run_folder
from sim2real.config.hydra_compose import hydra_compose
from sim2real.config.inherited import with_checkpoint
from sim2real.config.targets import ConfigError, build, check, check_named

PROGRAM = """
import contextlib, io, json, sys, tests.conftest
from sim2real.__main__ import main
answers = []
for argv in json.loads(sys.argv[1]):
    sys.argv, out, err, status = ["sim2real", *argv], io.StringIO(), io.StringIO(), 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main()
        except SystemExit as end:
            status = end.code
    answers.append([status, out.getvalue(), err.getvalue(), "torch" in sys.modules])
print(json.dumps(answers))
"""
ROOT = Path(__file__).resolve().parents[3]
MISTAKES = {
    ("env=hoper",): ["env=hoper", "did you mean 'hopper'", "walker2d"],
    ("+experiment=smok",): ["did you mean 'smoke'", "es_dr"],
    ("experiment=smok",): ["did you mean 'smoke'"],
    ("sed=3",): ["sed", "did you mean 'seed'"],
    ("+sed=3",): ["did you mean 'seed'"],
    ("run=trian",): ["did you mean 'train'"],
    ("seed=abc",): ["seed='abc'", "whole number"],
    ("seed=1.5",): ["seed=1.5", "whole number"],
    ("seed=-1",): ["seed=-1", "negative"],
    ("device=gpu",): ["auto, cpu, cuda", "did you mean 'cpu'"],
    ("algorithm.sigmaa=1",): ["algorithm.sigmaa", "did you mean 'sigma'"],
    ("+algorithm.sigmaa=1",): ["ESMAMLSettings does not accept 'sigmaa'", "did you mean 'sigma'"],
    ("algorithm.sigma=abc",): ["algorithm.sigma='abc'", "a number"],
    ("algorithm.optimizer=adm",): ["sgd, adam", "did you mean 'adam'"],
    ("policy.hidden=[8,x]",): ["policy.hidden", "list of which each is a whole number"],
    ("env.task._target_=os.system",): ["env.task", "os.system", "not allowed"],
    ("env.task._target_=envs.tasks.Hoper",): ["did you mean 'Hopper'"],
    ("algorithm.sigma=inf",): ["algorithm.sigma=inf", "finite"],
    ("+experiment=smoke", "algorithm=ppo"): ["algorithm.sigma", "leave algorithm=ppo out"],
    ("diagnose",): ["diagnose needs log=PATH"],
    ("replay", "there_is_none.csv"): ["log=there_is_none.csv", "no such file"],
    ("checkpoint=x",): ["checkpoint is not used by train"],
    ("run=evaluate", "resume=x"): ["resume is not used by evaluate", "checkpoint"],
    ("seed=[1",): ["[1"],
    ("-m", "seed=0,1", "policy=linear,mpl"): ["policy=mpl", "did you mean 'mlp'"],
    ("-m", "seed=0,x"): ["seed='x'"],
    ("-m", "seed=0,1", "--cfg", "job"): ["--cfg shows one configuration"],
    ("policy.initail=zero",): ["policy.initail", "did you mean 'initial'"],
    ("+experiment=es_dr", "params.draws.1.effect.friction_mode=seed"): [
        "(it is now params.draws.1.friction_mode)"
    ],
}


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, ...], list[Any]]:
    """Answers of one process, in an empty folder, to --help and to each of the mistakes."""
    asked = [["--help"], *map(list, MISTAKES)]
    folder = tmp_path_factory.mktemp("elsewhere")
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", PROGRAM, json.dumps(asked)]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert list(folder.iterdir()) == []
    return {tuple(a): answer for a, answer in zip(asked, json.loads(done.stdout), strict=True)}


def test_help_lists_experiments_and_groups(answers: dict[tuple[str, ...], list[Any]]) -> None:
    """--help names every experiment and group with a line on each, without importing torch."""
    status, out, _, torch_imported = answers["--help",]
    assert (status, torch_imported) == (0, False)
    for word in ("esmaml", "es_dr", "smoke", "walker2d", "evaluate", "tensorboard", "seed=0"):
        assert word in out
    about = next(line for line in out.splitlines() if line.startswith("  esmaml "))
    assert "main experiment" in about


@pytest.mark.parametrize("argv", MISTAKES, ids=" ".join)
def test_mistakes_are_answered_in_a_sentence(argv: tuple[str, ...], answers) -> None:
    """One line names place, value and remedy; torch is not imported and no file written."""
    status, _, err, torch_imported = answers[argv]
    assert (status, torch_imported) == (2, False)
    assert len(err.strip().splitlines()) == 1
    for part in MISTAKES[argv]:
        assert part in err


def test_composition_takes_values() -> None:
    """What the user sets arrives, at its place and with its type."""
    tree = compose(["+experiment=smoke", "seed=7", "algorithm.sigma=1", "policy=mlp2"])
    assert (tree["seed"], tree["algorithm"]["sigma"], tree["policy"]["hidden"]) == (7, 1, [32, 32])
    assert (tree["iterations"], tree["env"]["task"]["max_steps"]) == (2, 50)


def test_composing_within_a_job_leaves_its_hydra_alone() -> None:
    """A job that reads how another run was trained composes while Hydra runs the job itself."""
    with initialize_config_dir(str(CONF), version_base="1.3"):
        running = GlobalHydra.instance().hydra
        assert running is not None
        assert hydra_compose(["+experiment=smoke", "seed=7"])["seed"] == 7
        assert GlobalHydra.instance().hydra is running
    assert GlobalHydra.instance().hydra is None


def test_a_group_set_to_none_leaves_nothing_of_the_experiment() -> None:
    """`eval=none` beside an experiment's values for the evaluation means no evaluation."""
    tree = compose(["+experiment=smoke", "eval=none", "video=none"])
    assert tree["eval"] is None and tree["video"] is None


def test_a_choice_without_arguments_leaves_nothing_of_the_experiment() -> None:
    """`adapt=none` beside an experiment's adapt.sigma is right; the user's own is a mistake."""
    given = ["+experiment=hopper2_esmaml", "adapt=none"]
    assert compose(given)["adapt"] == {"_target_": "sim2real.learning.adapt.NoAdaptation"}
    with pytest.raises(ConfigError, match="sigma"):
        compose([*given, "+adapt.sigma=0.2"])


def test_sweep_jobs_try_every_value_once() -> None:
    """Checking a sweep costs the sum of its values, not the product."""
    jobs = list(sweep_jobs(["run=train", "seed=0,1,2", "params=none,fixed"]))
    assert len(jobs) == 4
    assert {line for job in jobs for line in job} == {
        *("seed=0", "seed=1", "seed=2", "params=none", "params=fixed", "run=train")
    }


def test_a_checkpoint_says_what_it_was_trained_with(tmp_path: Path) -> None:
    """A checkpoint brings its run's own parts along; what the user sets counts more."""
    (tmp_path / ".hydra").mkdir()
    lines = "- +experiment=smoke\n- policy=mlp\n- algorithm.sigma=0.3\n- seed=9\n"
    (tmp_path / ".hydra" / "overrides.yaml").write_text(lines)
    given = ["run=evaluate", f"checkpoint={tmp_path}"]
    tree = compose(given)
    assert (tree["policy"]["hidden"], tree["algorithm"]["sigma"], tree["seed"]) == ([32], 0.3, 0)
    assert tree["eval"]["adaptations"] == 2
    other = compose([*given, "policy=mlp2", "algorithm.sigma=0.4", "eval.episodes=3"])
    assert (other["policy"]["hidden"], other["algorithm"]["sigma"]) == ([32, 32], 0.4)
    assert other["eval"]["episodes"] == 3
    lines = "- +experiment=hopper2_esmaml\n"
    (tmp_path / ".hydra" / "overrides.yaml").write_text(lines)
    for verb in ("evaluate", "deploy"):
        tree = compose([f"run={verb}", f"checkpoint={tmp_path}", "adapt=none"])
        assert tree["adapt"] == {"_target_": "sim2real.learning.adapt.NoAdaptation"}
    lines = "- +experiment=quad8_esmaml\n- adapt.queries=3\n"
    (tmp_path / ".hydra" / "overrides.yaml").write_text(lines)
    own = compose(["run=deploy", f"checkpoint={tmp_path}", "robot=quad8"])["adapt"]
    assert (own["mode"], own["queries"], own["sigma"]) == ("sequential", 3, 0.1)
    assert with_checkpoint([*given, "+experiment=nav2d"]) == [*given, "+experiment=nav2d"]
    tuned = compose([f"start={tmp_path}", "effects=effects.yaml"])
    assert tuned["env"] == compose(["+experiment=quad8_esmaml"])["env"]
    assert (tuned["adapt"]["queries"], tuned["effects"]) == (3, "effects.yaml")


def resumable(folder: Path, *words: str) -> Path:
    """Write what the command line leaves of a run."""
    (folder / ".hydra").mkdir(parents=True)
    (folder / ".hydra" / "overrides.yaml").write_text(yaml.safe_dump(list(words)))
    save(compose(list(words)), folder)
    choices = {"hydra": {"runtime": {"choices": {"env": "nav2d", "policy": "mlp"}}}}
    (folder / ".hydra" / "hydra.yaml").write_text(yaml.safe_dump(choices))
    return folder


def test_a_resumed_run_is_configured_as_it_was(tmp_path: Path) -> None:
    """All that it was given holds; how long it goes on and on how many processes may change."""
    words = ("+experiment=nav2d", "algorithm.pairs=8", "seed=9", "iterations=40", "eval.episodes=3")
    run = resumable(tmp_path / "run", *words, "hydra.run.dir=somewhere")
    alone = compose([f"resume={run}"])
    assert alone == compose([*words, f"resume={run}"]) | {"resume": str(run)}
    more = compose([f"resume={run}", "iterations=60", "algorithm.shards=2", "eval=none"])
    assert (more["iterations"], more["algorithm"]["shards"], more["eval"]) == (60, 2, None)
    assert compose([f"resume={run}", *words])["seed"] == 9


@pytest.mark.parametrize(
    ("word", "both"),
    [
        ("seed=5", "seed=5: the run in .* has seed=9"),
        ("algorithm.pairs=16", "algorithm.pairs=16: the run in .* has algorithm.pairs=8"),
        ("algorithm.sigma=0.7", "algorithm.sigma=0.7: .* has algorithm.sigma=0"),
        ("env=hopper", "env=hopper: the run in .* has env=nav2d"),
        ("+experiment=smoke", r"experiment=smoke: the run in .* has experiment=nav2d"),
    ],
)
def test_what_contradicts_a_resumed_run_is_refused(tmp_path: Path, word: str, both: str) -> None:
    """With both values."""
    run = resumable(tmp_path / "run", "+experiment=nav2d", "algorithm.pairs=8", "seed=9")
    with pytest.raises(ConfigError, match=both):
        compose([f"resume={run}", word])


@pytest.mark.parametrize("word", ["algorithm.sigma=[1,2", "seed=1=2"])
def test_what_hydra_cannot_read_is_a_sentence(word: str) -> None:
    """With the word, and how such a value is quoted."""
    with pytest.raises(ConfigError, match=re.escape(f"{word}: cannot be read")) as caught:
        compose([word])
    assert "hydra.cc" not in str(caught.value)


def test_the_run_of_a_checkpoint_is_found(tmp_path: Path) -> None:
    """A checkpoint's file, its run's folder and its sweep's folder all lead to the run."""
    run = tmp_path / "sweep" / "0"
    (run / ".hydra").mkdir(parents=True)
    (run / ".hydra" / "overrides.yaml").write_text("[]\n")
    for path in (run, run / "checkpoints" / "checkpoint-1.torchrl", tmp_path / "sweep"):
        assert run_folder(path) == run
    assert run_folder(tmp_path / "nothing" / "there" / "at" / "all") is None


def test_a_saved_configuration_is_whole(tmp_path: Path) -> None:
    """config.yaml of a run holds every value, and can be checked and built again without Hydra."""
    import yaml

    tree = compose(["+experiment=smoke"])
    saved = yaml.safe_load(save(tree, tmp_path).read_text())
    assert saved == tree
    assert build(saved["adapt"], "adapt").episodes == 3


def test_no_cuda_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """`cuda` without a device is refused with what to write instead; `auto` falls back."""
    import torch

    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert device("auto") == device("cpu") == "cpu"
    with pytest.raises(ConfigError, match="device=cpu"):
        device("cuda")


@pytest.mark.parametrize(
    "target",
    [
        "torch.os.system",
        "torch.load",
        "torch.hub.load",
        "torchrl.nothing.There",
        "torch.subprocess.Popen",
    ],
)
def test_a_stranger_reaches_no_code(target: str) -> None:
    """Of torch and TorchRL only classes of their own are made, not what they import."""
    with pytest.raises(ConfigError, match="_target_"):
        build({"_target_": target}, "policy")


@pytest.mark.parametrize(
    "target",
    ["sim2real.config.targets.importlib", "sim2real.config.compose.os.system", "envs", 3, None],
)
def test_only_definitions_of_ours_are_targets(target: Any) -> None:
    """A module, a module's module or no name at all is refused without an import."""
    with pytest.raises(ConfigError, match="_target_"):
        check({"_target_": target}, "x")


def test_a_class_of_torch_is_built_and_its_names_checked() -> None:
    """A class of torch is checked by its own signature."""
    assert (
        build(
            {"_target_": "torch.nn.Linear", "in_features": 2, "out_features": 3}, "x"
        ).out_features
        == 3
    )
    with pytest.raises(ConfigError, match="did you mean 'in_features'"):
        build({"_target_": "torch.nn.Linear", "in_feature": 2, "out_features": 3}, "x")


@pytest.mark.parametrize(
    ("tree", "words"),
    [
        ({"_target_": "torchrl.envs.DoubleToFloat"}, "give this one a name"),
        ({"norm": None}, "transforms.norm=null: .* write ~transforms.norm"),
        ({"norm": {"decay": 1.0}}, "expected a mapping with a _target_"),
    ],
)
def test_objects_that_stand_by_name_need_one_each(tree: dict[str, Any], words: str) -> None:
    """A part without a name, or a name without a part, is refused before any work starts."""
    with pytest.raises(ConfigError, match=words):
        check_named(tree, "transforms")


def test_a_part_without_a_name_is_refused_by_the_command() -> None:
    """What `null` leaves is no transform; `~` leaves it out."""
    lines = ["+experiment=smoke", "transforms.randomize_params=null"]
    with pytest.raises(ConfigError, match=r"write ~transforms\.randomize_params"):
        compose(lines)
    assert compose(["+experiment=smoke", "~transforms.randomize_params"])["transforms"] == {}


def test_missing_arguments_are_named() -> None:
    """An object that lacks arguments is refused with their names, a partial one is not."""
    tree = {"_target_": "sim2real.learning.adapt.HillClimb", "mode": "batch"}
    with pytest.raises(ConfigError, match="queries, parallel, sigma"):
        check(tree, "adapt")
    check(tree | {"_partial_": True}, "adapt")
