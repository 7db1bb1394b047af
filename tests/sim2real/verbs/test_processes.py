"""No command leaves a process behind: each runs in a session of its own, which is empty then.

A verb, a collector or a verb of `python -m hardware` that comes without a case here fails the first
test.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from hardware.commands import KEYS as HARDWARE
from sim2real.config.catalogue import CONF
from tests.sim2real.made_runs import make_run
from tests.sim2real.trained import SMALL_ES, train

ROOT = Path(__file__).resolve().parents[3]
PATIENCE = 400.0  # s that a command may take
LAST = 2.0  # s after which what is left of a session counts
WARM = 300.0  # s that a command may take until it starts processes
SETTLED = 5.0  # s that its processes are there
BENCH = "robot=bench1"
POLICY = "checkpoint=run"
TRAIN = ("run=train", "env=nav2d", "params=goals", "algorithm=ppo_sb3", "algorithm.num_rows=4")
TRAIN += ("algorithm.steps=32", "algorithm.epochs=1", "iterations=2", "eval=none")
POPULATION = ("run=train", "+experiment=smoke", "algorithm.shards=2", "eval=none")
EXAM = ("run=blindcheck", "exam=small", "exam.robots=[bench1]", "exam.one=1", "exam.two=0")
EXAM += ("exam.none=1", "exam.excluded=0", "exam.sample=2", "exam.longest=60", "exam.most=1")
QUICK = ("trials=2", "settle=0.1", "seconds=6", "motions=[ramp,steps]")
IMPROVE = ("run=improve", POLICY, BENCH, *QUICK, "rollouts=2", "rounds=1", "iterations=2")
COMMANDS: dict[str, tuple[str, ...]] = {  # by verb, and what of it is meant
    "train collector=fast": (*TRAIN, "collector=fast"),
    "train collector=sync": (*TRAIN, "collector=sync"),
    "train collector=processes": (*TRAIN, "collector=processes"),
    "train collector=none": POPULATION,
    "train sweep": ("-m", *TRAIN, "collector=fast", "seed=0,1"),
    "train sweep of two at a time": (
        *("-m", *TRAIN, "collector=fast", "seed=0,1"),
        *("hydra/launcher=joblib", "hydra.launcher.n_jobs=2"),
    ),
    "evaluate": (
        *("run=evaluate", "checkpoint=hopper", "eval=grid_hopper", "eval.grid.axes.0.count=2"),
        *("eval.grid.axes.1.count=2", "eval.adaptations=2", "eval.episodes=1"),
    ),
    "export": ("run=export", POLICY),
    "record": ("run=record", BENCH, "seconds=2"),
    "record leader": (
        *("run=record", "leader=so101_leader", "follower=so101"),
        *(f"robot.model={ROOT}/tests/hardware/so101.xml", "seconds=2"),
    ),
    "convert": ("run=convert", "log=recording"),
    "replay": ("run=replay", "log=recording"),
    "contract": ("run=contract", "log=deployed/logs"),
    "diagnose": ("run=diagnose", "log=recording"),
    "compare": ("run=compare", "before=recording", "after=recording"),
    "identify": (
        *("run=identify", "log=recording", "candidates=[coulomb_friction]"),
        "identify.search.generations=3",
    ),
    "investigate": ("run=investigate", BENCH, "seconds=8", "budget=8"),
    "deploy": ("run=deploy", POLICY, BENCH, "trials=2", "settle=0.1"),
    "improve": IMPROVE,
    "improve by=returns": (
        *(*IMPROVE, "by=returns", "params=bench1_dr"),
        *("bayrn.first=2", "bayrn.rounds=2"),
    ),
    "worth": ("run=worth", POLICY, "effects=effects.yaml", "rollouts=4"),
    "report": ("run=report", "runs=runs"),
    "view": ("run=view", BENCH, "motions=[ramp]", "seconds=1", "video=film"),
    "blindcheck": EXAM,
}
PORTLESS = {  # verbs of python -m hardware, on the emulated robot; a person is not at hand
    "find-port": (),
    "scan": (BENCH,),
    "setup": (BENCH,),
    "calibrate": (BENCH, "file=zeros.json"),
    "monitor": (BENCH, "seconds=1"),
    "read": (BENCH, "servo=hinge", "register=position_p_gain"),
    "write": (BENCH, "servo=hinge", "register=position_p_gain", "value=400"),
    "reboot": (BENCH, "servo=hinge"),
    "torque": (BENCH,),
    "nominal": (BENCH, "file=with_servos.xml"),
    "pack": ("folder=recording", "file=packed.zip"),
    "emulate": (BENCH, "seconds=1"),
}
LACKING = "install the extra", "pip install", "no renderer", "display", "draw"  # of this machine


def test_every_verb_and_collector_has_a_case() -> None:
    """What is added later is asked as well."""
    verbs = {path.stem for path in (CONF / "run").glob("*.yaml")}
    collectors = {path.stem for path in (CONF / "collector").glob("*.yaml")}
    assert {name.split()[0] for name in COMMANDS} == verbs
    assert {f"train collector={name}" for name in collectors} <= set(COMMANDS)
    assert set(PORTLESS) == set(HARDWARE)


def session(number: int) -> Iterator[int]:
    """Yield the processes of a session."""
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                after = (folder / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue  # it has ended
            if int(after[3]) == number and after[0] != "Z":
                yield int(folder.name)


def start(folder: Path, module: str, *words: str) -> subprocess.Popen[str]:
    """Start a command in a session of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", module, *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def ended(started: subprocess.Popen[str], patience: float = PATIENCE) -> tuple[str, list[int]]:
    """Wait for a command; return what it said, and what is left of its session."""
    try:
        said, _ = started.communicate(timeout=patience)
    finally:
        if started.poll() is None:
            os.killpg(started.pid, signal.SIGKILL)
    until = time.monotonic() + LAST
    while (left := list(session(started.pid))) and time.monotonic() < until:
        time.sleep(LAST / 20)
    return said, left


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two policies, a recording, a deployment, causes and evaluated runs."""
    path = tmp_path_factory.mktemp("commands")
    train(path / "run", SMALL_ES)
    train(path / "hopper", ["+experiment=smoke", "eval=none", "algorithm.shards=1", "iterations=1"])
    (path / "effects.yaml").write_text(
        yaml.safe_dump([{"effect": "motor_strength", "where": "hinge", "value": 0.5}])
    )
    for seed in (0, 1):
        make_run(path / "runs", "udr", seed, (100.0, 80.0))
        make_run(path / "runs", "ppo_source", seed, (110.0, 60.0))
    for words in (
        ("run=record", BENCH, "seconds=12", "hydra.run.dir=recording"),
        ("run=deploy", POLICY, BENCH, "trials=2", "settle=0.1", "hydra.run.dir=deployed"),
    ):
        said, _ = ended(start(path, "sim2real", *words))
        assert (path / words[-1].partition("=")[2]).is_dir(), said
    return path


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="needs /proc")
@pytest.mark.parametrize("name", COMMANDS)
def test_no_verb_leaves_a_process_behind(name: str, folder: Path) -> None:
    """Each ends by itself, well, and with it everything that it started."""
    started = start(folder, "sim2real", *COMMANDS[name])
    said, left = ended(started)
    assert left == [], said[-2000:]
    answered = {0, 3, 4} if name in ("contract", "compare") else {0}
    if started.returncode == 2 and any(word in said for word in LACKING):
        pytest.skip(said[-200:])
    assert started.returncode in answered, said[-3000:]


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="needs /proc")
@pytest.mark.parametrize("verb", PORTLESS)
def test_no_verb_of_the_hardware_leaves_a_process_behind(verb: str, folder: Path) -> None:
    """Where it needs a person or a port, it says so and ends too."""
    started = start(folder, "hardware", verb, *PORTLESS[verb])
    said, left = ended(started, 60.0)
    assert left == [] and "Traceback" not in said, said[-2000:]
    assert started.returncode in {"find-port": (0, 1), "calibrate": (2,)}.get(verb, (0,)), said


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="needs /proc")
@pytest.mark.parametrize(
    "words",
    [
        (*TRAIN, "collector=processes", "iterations=100000"),
        (*EXAM, "exam.longest=600"),
        (*COMMANDS["train sweep of two at a time"], "iterations=100000"),
    ],
    ids=["collector", "exam", "sweep"],
)
def test_ctrl_c_leaves_no_process_behind(words: tuple[str, ...], folder: Path) -> None:
    """Of commands that have processes of their own: it ends all of them, without a traceback."""
    started = start(folder, "sim2real", *words)
    until, since = time.monotonic() + WARM, time.monotonic()
    while time.monotonic() - since < SETTLED and time.monotonic() < until:
        time.sleep(0.5)
        if len(list(session(started.pid))) < 2:  # a look at what can be drawn is short
            since = time.monotonic()
    assert len(list(session(started.pid))) > 1, "no process was started"
    os.killpg(started.pid, signal.SIGINT)  # as a terminal does: to all of its processes
    said, left = ended(started)
    assert left == [] and "Traceback" not in said, said[-3000:]
    assert started.returncode == 130, said[-2000:]
