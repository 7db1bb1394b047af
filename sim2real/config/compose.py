"""The configuration of a run: its root keys, its checks, and one sentence for each mistake.

    config = compose(["+experiment=smoke", "seed=3"])      # a plain tree, checked
    verb, arguments = prepare(config, out=Path("outputs/mine"))
    verb(**arguments)

A verb is a function whose keyword-only arguments are root keys. Nothing below this module knows
Hydra.
"""

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException, OverrideParseException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from envs.errors import did_you_mean
from sim2real.config import extensions, signatures
from sim2real.config.catalogue import EXPERIMENT, options
from sim2real.config.folders import free_folder
from sim2real.config.hydra_compose import hydra_compose
from sim2real.config.inherited import LEARNING, RESOLVED, inherited, key_of
from sim2real.config.optional_keys import with_plus
from sim2real.config.renamed import renamed_key_hint
from sim2real.config.targets import (
    ConfigError,
    build,
    build_named,
    check,
    check_named,
    import_target,
    marked,
)
from sim2real.runs.files import write_text

ALWAYS = ("run", EXPERIMENT, "hydra")  # keys that any verb may be given
PARTS = (
    "sim2real.learning.parts.build_components"  # makes a verb's `parts` of the root keys it names
)
OPTIONAL = ("eval", "video", *LEARNING)  # groups that can be none
NAMED = ("transforms",)  # groups of objects by name
DATA = ("robot", "stops", "limits")  # groups that are read as they are, no class is made of them
ASSETS = Path(__file__).resolve().parents[2] / "envs" / "assets"

# ${asset:demo/arm2.csv} is a file that comes with the project, wherever it is installed.
# ${mul:a,b} is the product of two numbers.
# ${free:outputs/now} is a folder that no other run has; it is made when it is first asked for.
OmegaConf.register_new_resolver("mul", lambda a, b: a * b, replace=True)
OmegaConf.register_new_resolver("asset", lambda name: str(ASSETS / name), replace=True)
OmegaConf.register_new_resolver("free", free_folder, use_cache=True, replace=True)

Maker = Callable[..., Any]  # of what is made later, with arguments that a run gives


@dataclass
class Config:
    """The root keys and their types; conf/config.yaml holds the values and says what they mean."""

    run: Maker
    env: Maker
    params: dict[str, Any]
    transforms: dict[str, Any]
    policy: Maker
    adapt: dict[str, Any]
    algorithm: Maker
    collector: Maker | None
    advantage: Maker | None
    loss: Maker | None
    buffer: Maker | None
    optimizer: Maker | None
    eval: dict[str, Any] | None
    logger: dict[str, Any]
    video: dict[str, Any] | None
    cluster: dict[str, Any] | None
    robot: dict[str, Any]
    exam: dict[str, Any]
    port: str | list[str] | None
    imu_port: str | None
    calibration: str | None
    arm: bool
    dry_run: bool
    trials: int
    rounds: int
    tolerance: float
    stand: bool
    settle: float
    stops: dict[str, Any] | None
    motions: list[str]
    seconds: float
    size: float
    leader: str | None
    leader_port: str | None
    leader_calibration: str | None
    leader_scale: list[str]
    budget: float
    target: Maker | None
    by: str
    log: str | list[str] | None
    candidates: str | list[str] | None
    identify: dict[str, Any]
    bayrn: dict[str, Any]
    model: str | None
    joints: list[str]
    columns: str | None
    to: Literal["mjcf", "mjlab"] | None
    viewer: Literal["rerun"] | None
    effects: str | None
    exclude: list[str]
    against: str | None
    actor: str | None
    observation: str | None
    before: str | list[str] | None
    after: str | list[str] | None
    units: list[str]
    ci: str | None
    watch: list[str]
    limits: dict[str, Any] | None
    remounted: bool
    diagnosis: str | None
    rollouts: int
    seed: int
    device: Literal["auto", "cpu", "cuda"]
    iterations: int | None
    frames: int | None
    checkpoint_every: int
    keep_checkpoints: int
    checkpoint: str | list[str] | None
    runs: str | list[str] | None
    baseline: str | None
    expect: dict[str, Any] | None
    start: str | None
    resume: str | None


def compose(overrides: list[str]) -> dict[str, Any]:
    """Compose and check a configuration without running it.

    Args:
        overrides: overrides as on the command line, such as `+experiment=smoke` or `seed=3`.

    Raises:
        ConfigError: see `validate`; a name or a value that is not there.
    """
    try:
        every = inherited(overrides)
        return validate(hydra_compose(with_plus(every, every)), overrides)
    except yaml.YAMLError as error:
        raise ConfigError(f"invalid YAML: {' '.join(str(error).split())}") from error
    except (HydraException, OmegaConfBaseException) as error:
        raise explain(error, overrides) from error


def validate(config: DictConfig, overrides: list[str] | None = None) -> dict[str, Any]:
    """Return the configuration as a plain tree, after every check that needs no import of torch.

    Args:
        config: the configuration that Hydra composed.
        overrides: what the user set, to be refused if the verb does not use it.

    Raises:
        ConfigError: a key that is unknown or that the verb does not use; a value of the wrong type.
    """
    tree: dict[str, Any] = OmegaConf.to_container(config, resolve=True)  # type: ignore[assignment]
    tree = {key: _alone(value, key, overrides or []) for key, value in tree.items()}
    root = marked({"_target_": "sim2real.config.compose.Config", **tree})
    tree = {key: value for key, value in root.items() if key != "_target_"}
    try:
        check(root, "")
    except ConfigError as error:
        raise _blamed(error, overrides or []) from None
    verb = _verb(tree)
    unused = [
        key for key in _roots(overrides or []) if key not in _keys(verb) and key not in ALWAYS
    ]
    if unused:
        raise ConfigError(
            f"{unused[0]} is not used by {_name(tree)}; leave it out, "
            f"or set one of: {', '.join(_keys(verb))}"
        )
    for key in OPTIONAL:  # an experiment's values for a group that was then set to none
        if "_target_" not in (tree[key] or {}):
            tree[key] = None
    for key in _keys(verb):
        if key in NAMED:
            check_named(tree[key], key)
            continue
        check(tree[key], key)
        if isinstance(tree[key], dict) and "_target_" not in tree[key] and key not in DATA:
            raise ConfigError(f"{key} has no _target_; choose one: {', '.join(options(key))}")
    if tree["seed"] < 0:
        raise ConfigError(f"seed={tree['seed']} must not be negative")
    return tree


def _blamed(error: ConfigError, overrides: list[str]) -> ConfigError:
    """Say where a wrong value comes from if it is an experiment's, meant for another choice."""
    given = {key_of(line): line.partition("=")[2] for line in overrides}
    place = re.split(r"[:=]", str(error))[0]
    group = place.split(".")[0]
    if group not in given or EXPERIMENT not in given or place in given:
        return error
    choice = f"{group}={given[group]}"
    return ConfigError(
        f"{error}; that value is of {EXPERIMENT}={given[EXPERIMENT]}, which is made for another "
        f"{group}: leave {choice} out, or take an experiment for it"
    )


def _alone(value: Any, key: str, overrides: list[str]) -> Any:
    """Take an experiment's values off a choice without arguments, such as adapt=none.

    They were meant for the choice that it replaced. What the user sets stays, and is refused.
    """
    target = value.get("_target_") if isinstance(value, dict) else None
    found = signatures.find(target) if isinstance(target, str) else None
    if found is None or found.arguments or found.open:
        return value
    own = {key_of(line) for line in overrides}
    return {name: v for name, v in value.items() if name == "_target_" or f"{key}.{name}" in own}


def save(tree: dict[str, Any], out: Path) -> Path:
    """Write the configuration, all of it resolved, into the run's folder."""
    return write_text(out / RESOLVED, yaml.safe_dump(tree, sort_keys=False, allow_unicode=True))


def instantiate(tree: dict[str, Any], out: Path) -> tuple[Any, dict[str, Any]]:
    """Return the verb and its arguments, built. This imports torch.

    Args:
        tree: a checked configuration.
        out: the run's folder.

    Raises:
        ConfigError: a device that is not there, or a module of the user's that fails.
        ValueError: a value that a constructor refuses.
    """
    extensions.load()
    verb = _verb(tree)
    makes = {True: build_named, False: build}
    arguments = {key: makes[key in NAMED](tree[key], key) for key in _keys(verb)}
    if "device" in arguments:
        arguments["device"] = device(tree["device"])
    if "parts" in verb.arguments:
        own = {key: arguments[key] for key in _of_parts()}
        arguments["parts"] = import_target(PARTS, "parts")(**own)
    if "out" in verb.arguments:
        arguments["out"] = out
    taken = {key: value for key, value in arguments.items() if key in verb.arguments}
    return import_target(tree["run"]["_target_"], "run"), taken


def device(name: str) -> str:
    """Return "cpu" or "cuda" for a device key, "auto" being CUDA where there is one.

    Raises:
        ConfigError: "cuda" on a machine without.
    """
    import torch  # here, so that a mistyped name is answered before this import

    available = torch.cuda.is_available()
    if name == "cuda" and not available:
        raise ConfigError(
            "device=cuda: PyTorch finds no CUDA device here; use device=cpu or device=auto"
        )
    return "cuda" if name != "cpu" and available else "cpu"


def sweep_jobs(overrides: list[str]) -> Iterator[list[str]]:
    """Yield jobs of a sweep in which every swept value occurs once: enough to check them all."""
    parsed = OverridesParser.create().parse_overrides(overrides)
    ways = [[o.input_line or ""] for o in parsed]
    for place, override in enumerate(parsed):
        if override.is_discrete_sweep() and "glob(" not in (override.input_line or ""):
            key = (override.input_line or "").split("=")[0]
            ways[place] = [f"{key}={value}" for value in override.sweep_string_iterator()]
        elif override.is_sweep_override():
            ways[place] = []
    first = [values[0] for values in ways if values]
    yield first
    for values in ways:
        for value in values[1:]:
            yield [value if line == values[0] else line for line in first]


def explain(error: Exception, overrides: list[str]) -> ConfigError:
    """Return one sentence for an error of Hydra's, with the nearest match of an unknown name."""
    text = str(error)
    if isinstance(error, OverrideParseException):
        key = error.override.partition("=")[0]
        return ConfigError(
            f"{error.override}: cannot be read; a value with =, a comma or a bracket stands "
            f"in quotes that the shell leaves: {key}='\"VALUE\"'"
        )
    if match := re.search(r"Could not find '(.+)/([^/']+)'", text):
        group, name = match.groups()
        known = options(group)
        allowed = f"; choose one of: {', '.join(known)}" if known else ""
        return ConfigError(f"{group}={name}: no such choice{did_you_mean(name, known)}{allowed}")
    if match := re.search(r"Could not (?:override|append to config|delete).* '([^']+)'", text):
        return ConfigError(_unknown(match[1], overrides))
    lines = [line.strip() for line in str(error.__cause__ or error).splitlines() if line.strip()]
    key = next(
        (line.split(":", 1)[1].strip() for line in lines if line.startswith("full_key:")), ""
    )
    if key and "not in" in lines[0]:
        return ConfigError(_unknown(key, overrides))
    sentence = " ".join(
        line
        for line in lines
        if not re.match(r"(full_key|object_type|reference_type)\s*[:=]", line)
    )
    return ConfigError(f"{key}: {sentence}" if key else sentence)


def _unknown(key: str, overrides: list[str]) -> str:
    """Name an unknown key, the keys that its parent has, and the nearest one."""
    parent, _, name = key.lstrip("+~").rpartition(".")
    known = sorted(
        _siblings(parent, [o for o in overrides if not o.lstrip("+~").startswith(key.lstrip("+~"))])
    )
    known_keys = f"; {parent or 'the configuration'} has: {', '.join(known)}" if known else ""
    hint = renamed_key_hint(key.lstrip("+~")) or did_you_mean(name, known)
    return f"{key}: there is no such key{hint}{known_keys}"


def _siblings(parent: str, overrides: list[str]) -> Iterable[str]:
    if not parent:
        return [*(f.name for f in fields(Config)), EXPERIMENT]
    try:
        node = OmegaConf.select(hydra_compose(overrides), parent)
    except (HydraException, OmegaConfBaseException):
        return []
    return (
        [str(k) for k in node if k not in ("_target_", "_partial_")]
        if isinstance(node, DictConfig)
        else []
    )


def _verb(tree: dict[str, Any]) -> signatures.Signature:
    check(tree["run"], "run")
    found = signatures.find(tree["run"].get("_target_", ""))
    if found is None:
        raise ConfigError("run has no _target_; choose one of: " + ", ".join(options("run")))
    return found


def _name(tree: dict[str, Any]) -> str:
    """Return the verb's name: its module's."""
    return tree["run"]["_target_"].split(".")[-2]


def _keys(verb: signatures.Signature) -> list[str]:
    """Return the root keys that a verb uses, those of its parts included."""
    known = {f.name for f in fields(Config)}
    parts = _of_parts() if "parts" in verb.arguments else []
    return [key for key in dict.fromkeys([*parts, *verb.arguments]) if key in known]


def _of_parts() -> list[str]:
    """Return the root keys that an algorithm's parts are made of."""
    found = signatures.find(PARTS)
    return [] if found is None else list(found.arguments)


def used_keys(tree: dict[str, Any]) -> list[str]:
    """Return the root keys that the verb of a configuration uses, those of its parts included."""
    return _keys(_verb(tree))


def _roots(overrides: list[str]) -> list[str]:
    parsed = OverridesParser.create().parse_overrides(overrides)
    return [(o.package or o.key_or_group).split(".")[0].split("/")[0] for o in parsed]
