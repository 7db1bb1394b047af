"""The catalogue of conf/, read from its files only: groups, their choices, and a line on each."""

from collections.abc import Iterator
from pathlib import Path

import yaml

from sim2real.config import signatures

CONF = Path(__file__).resolve().parents[2] / "conf"
EXPERIMENT = "experiment"
_INTRODUCTION = """\
sim2real: find out why a policy that works in simulation fails on the robot, and train one that
transfers.

  python -m sim2real diagnose LOG.csv MODEL.xml     which physical effect the simulator lacks
  python -m sim2real view REPORT.html               the report in a browser
  python -m sim2real +experiment=NAME               one job
  python -m sim2real +experiment=NAME seed=3        the same with another value
  python -m sim2real +experiment=NAME adapt=none    the same with another choice of a group
  python -m sim2real -m +experiment=NAME seed=0,1   a sweep; hydra/launcher=joblib: side by side
  python -m sim2real run=evaluate checkpoint=PATH   another verb
  python -m sim2real +experiment=NAME --cfg job     show the configuration and run nothing"""


def groups() -> list[str]:
    """Return the groups that a run is made of, experiments first, then as in conf/config.yaml."""
    root = yaml.safe_load((CONF / "config.yaml").read_text(encoding="utf-8"))
    return [
        EXPERIMENT,
        *(group for entry in root["defaults"] if entry != "_self_" for group in entry),
    ]


def options(group: str) -> list[str]:
    """Return the choices of a group; [] if there is no such group."""
    return sorted(files(group))


def files(group: str) -> dict[str, Path]:
    """Return the choices of a group and their files, a user's own (`--config-dir`) among them."""
    places = [CONF, *filter(None, [signatures.OWN.get("")])]
    return {path.stem: path for place in places for path in (place / group).glob("*.yaml")}


def summary(path: Path) -> str:
    """Return the first comment of a YAML file, one line."""
    for line in path.read_text(encoding="utf-8").splitlines():
        text = line.removeprefix("#").strip()
        if line.startswith("#") and not text.startswith("@package"):
            return text
    return ""


def lines() -> Iterator[str]:
    """Yield the lines of --help."""
    yield _INTRODUCTION
    for group in groups():
        yield f"\n{'+' if group == EXPERIMENT else ''}{group}="
        for option, path in sorted(files(group).items()):
            yield f"  {option:<18} {summary(path)}".rstrip()
    yield "\nother keys (config.yaml explains them):"
    for key, comment in keys(CONF / "config.yaml"):
        yield f"  {key:<18} {comment}"


def keys(path: Path) -> Iterator[tuple[str, str]]:
    """Yield the top-level keys of a YAML file that have a value there, with their comments."""
    for line in path.read_text(encoding="utf-8").splitlines():
        key, colon, rest = line.partition(":")
        if colon and key.isidentifier() and rest.partition("#")[0].strip():
            yield f"{key}={rest.partition('#')[0].strip()}", rest.partition("#")[2].strip()
