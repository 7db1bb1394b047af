"""The page on the first real robot, as it is typed: from servos with ID 1 to a diagnosed log."""

import json
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from hardware import commands
from hardware.command_line import parse_keys
from hardware.config import Robot, load_robot
from hardware.robot_files import ROBOTS
from sim2real.config.arguments import as_overrides
from tests.hardware.person import places_of
from tests.hardware.test_wizard import Desk as VirtualDesk
from tests.sim2real.trained import run_verb

ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs" / "how-to" / "first_robot.md"
FORM = ROOT / ".github" / "ISSUE_TEMPLATE" / "first_robot.yml"
ATTEMPTS = 5  # of what needs real time, on a busy machine


def rehearsal() -> list[str]:
    """Return the lines that the page tells to type."""
    blocks = re.findall(r"<!-- rehearsal -->\n```\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert len(blocks) == 2
    return [line for block in blocks for line in block.splitlines()]


class Desk:
    """The first terminal: an emulated robot, and the hands beside it.

    Args:
        line: the command line that emulates it.
        joints: the least and the largest angle of each joint [rad].
    """

    def __init__(self, line: str, joints: dict[str, tuple[float, float]]) -> None:
        words = [sys.executable, *shlex.split(line)[1:]]
        self._process = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._joints, self._at = joints, dict[str, float]()
        assert "; Ctrl-C ends it" in self._read()

    def _read(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline()

    def type(self, line: str) -> str:
        """Type a line, and return what is printed for it."""
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        return self._read()

    def __call__(self, prompt: str, meanwhile: Callable[[], object] | None = None) -> str:
        """Do what a verb asks for, as the page says it is done."""
        if "write these" in prompt:
            return "y"
        for line in self._lines(prompt):
            printed = self.type(line)
            assert printed.startswith(("connected", "unplugged")) or " is at " in printed, printed
            if meanwhile is not None:
                meanwhile()
        return ""

    def _lines(self, prompt: str) -> Iterator[str]:
        if "connect it alone" in prompt:
            name = prompt.partition("(")[2].partition(")")[0]
            yield from ("unplug all", f"connect {name}")
            return
        if "connect all" in prompt:
            yield "connect all"
            return
        name = prompt[prompt.rindex("move ") :].split()[1]
        low, high = self._joints[name]
        where = {"one end": low, "the other end": high, "to its zero": 0.0, "angle grows": 0.08}
        place = next(angle for words, angle in where.items() if words in prompt)
        here = self._at.get(name, 0.0)
        for part in np.linspace(here, place, 2 + int(abs(place - here)))[1:]:  # 1 rad at most
            yield f"move {name} {part:.4f}"
        self._at[name] = place

    def end(self) -> None:
        """Leave it as Ctrl-C does."""
        self._process.terminate()
        self._process.wait(30)


def run(line: str, desk: Desk) -> int:
    """Run a line of the second terminal, and return its exit status."""
    words = shlex.split(line)
    if words[:3] == ["python", "-m", "hardware"]:
        return commands.main(words[3:], desk)
    assert words[0] == "sim2real"
    return subprocess.run([sys.executable, "-m", *words], check=False).returncode


def again(line: str, desk: Desk) -> None:
    """Run a line until it succeeds: a busy machine may be told that it is too slow."""
    for _ in range(ATTEMPTS):
        if run(line, desk) == 0:
            return
        time.sleep(1.0)
    raise AssertionError(line)


def test_the_page_and_the_form_go_together() -> None:
    """Each step of the table has a line in the log, and the form asks for what the page says."""
    text = PAGE.read_text()
    steps = [int(n) for n in re.findall(r"^\| (\d+) ", text, re.MULTILINE)]
    assert steps == list(range(1, 12))
    log = text[text.index("```text") :]
    assert [int(n) for n in re.findall(r"^(\d+)$", log, re.MULTILINE)] == steps[:-1]
    form = yaml.safe_load(FORM.read_text())
    asked = {item["id"] for item in form["body"] if "id" in item}
    assert asked == {"robot", "power", "version", "steps", "torque", "moved", "cause", "files"}
    assert form["name"] in text
    for page in ("README.md", "docs/index.md", "docs/how-to/set_up_servos.md"):
        head = (ROOT / page).read_text()[:1500]
        assert "No real robot has run" in head and "first_robot.md" in head


def koch(folder: Path) -> tuple[str, Path]:
    """Return the Koch's name and a model of it, made as the page says."""
    stand_ins = pytest.importorskip("tests.hardware.stand_ins")
    (line,) = re.findall(r"`(python -m hardware nominal robot=koch [^`]*)`", PAGE.read_text())
    words = shlex.split(line)[3:]
    public, made = stand_ins.public_model("koch", folder), folder / "with_servos.xml"
    keys = parse_keys(words[0], words[1:], commands.KEYS) | {"model": public, "file": made}
    assert commands.main([words[0], *(f"{key}={value}" for key, value in keys.items())]) == 0
    return "koch", made


KOCH = pytest.mark.skipif(not (ROBOTS / "koch.yaml").exists(), reason="conf/robot has no koch")


def lines_for(name: str, folder: Path) -> tuple[list[str], Robot]:
    """Return the page's lines for a robot, with a port in this folder, and the robot."""
    lines = [line.replace("/tmp/desk", str(folder / "desk")) for line in rehearsal()]
    if name == "arm6":
        return lines, load_robot(name)
    _, model = koch(folder)
    for old, new in (
        (r"(hardware .*)robot=arm6", rf"\1robot={name} model={model}"),
        (r"record robot=arm6", f"record robot={name} robot.model={model}"),
    ):
        lines = [re.sub(old, new, line) for line in lines]
    return lines, load_robot(name, str(model))


def check(folder: Path) -> None:
    """Look whether the hidden friction is named, and what is to be sent is there."""
    report = json.loads((folder / "first/diagnosis/report.json").read_text())
    causes = {(cause["effect"], cause["where"]): cause["value"] for cause in report["causes"]}
    assert causes["coulomb_friction", "elbow"] == pytest.approx(0.3, abs=0.08)
    assert (folder / "first.zip").is_file()


ROBOTS_TRIED = ["arm6", pytest.param("koch", marks=KOCH)]


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", ROBOTS_TRIED)
def test_the_page_in_virtual_time(name: str, tmp_path: Path, monkeypatch) -> None:
    """The page line by line, its port in this process: no machine is too busy for it."""
    monkeypatch.chdir(tmp_path)
    lines, robot = lines_for(name, tmp_path)
    subprocess.run(lines[0], shell=True, check=True)
    keys = parse_keys("emulate", shlex.split(lines[1])[4:], commands.KEYS)
    places = {servo.name: places_of(*servo.position, up=0.08) for servo in robot.servos}
    desk = VirtualDesk(replace(robot, hidden=Path(keys["hidden"])), places)
    desk.attach(monkeypatch)
    monkeypatch.setattr("sim2real.deployment.record.make_driver", lambda r, _: desk.make_driver(r))
    for line in lines[2:]:
        words = shlex.split(line)
        if words[0] == "sim2real":
            overrides = as_overrides(words[1:])
            out = next(o.partition("=")[2] for o in overrides if o.startswith("hydra.run.dir="))
            kept = [o for o in overrides if not o.startswith("hydra.run.dir=")]
            run_verb(kept, Path(out))
        else:
            assert commands.main(words[3:], desk.person) == 0, line
    assert not desk.world.firmware.torque_on.any()
    check(tmp_path)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", ROBOTS_TRIED)
def test_the_page_as_it_is_typed(name: str, tmp_path: Path, monkeypatch) -> None:
    """The page alone in two terminals, in real time over the device file."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    lines, robot = lines_for(name, tmp_path)
    subprocess.run(lines[0], shell=True, check=True)
    desk = Desk(lines[1], {servo.name: servo.position for servo in robot.servos})
    try:
        for line in lines[2:]:
            again(line, desk)
    finally:
        desk.end()
    check(tmp_path)
