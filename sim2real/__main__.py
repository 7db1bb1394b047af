"""The command line: python -m sim2real [VERB] [+experiment=NAME] [KEY=VALUE ...]; --help lists it.

A configuration is composed and checked before anything heavy is imported and before a file is
written. What a user can get wrong is answered in one sentence and with exit status 2;
HYDRA_FULL_ERROR=1 shows the whole traceback.
"""

from __future__ import annotations

import linecache
import logging
import os
import sys
from contextlib import suppress
from importlib import metadata
from pathlib import Path
from typing import Any

from sim2real.runs.errors import Refused, Sim2RealError
from sim2real.runs.terminal import is_page, open_page

FULL = "HYDRA_FULL_ERROR"
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")  # NumPy's and torch's
WANTED = "SIM2REAL_FULL_ERROR"  # what the user set FULL to, while Hydra runs with 1
PASSED_ON = ("--info", "-i", "--hydra-help", "--shell-completion", "-sc")
EXTRAS = {  # packages that only some verbs need, and the extra that brings them
    "torch": "train",
    "torchrl": "train",
    "tensordict": "train",
    "hydra_plugins.hydra_joblib_launcher": "train",
    "imageio_ffmpeg": "film",
    "PIL": "film",
    "cma": "identify",
    "ot": "identify",
    "pyarrow": "data",
    "onnxruntime": "onnx",
    "h5py": "data",
    "zarr": "data",
    "mcap": "ros",
    "rosbags": "ros",
}
ROOMS = ("sim2real", "envs", "hardware")  # of this project
FULL_MEMORY = ("bad_alloc", "can't allocate memory", "not allocate memory")  # C++, torch, MuJoCo
OTHER_ROOT = ("--config-path", "-cp", "--config-name", "-cn")


class Answered(BaseException):
    """The exit status of a verb whose answer has one; no Exception, as `Refused`."""


def main() -> None:
    """Run the command line."""
    os.environ.setdefault("RL_LOGGING_LEVEL", "WARNING")  # TorchRL logs each buffer
    for name in THREADS:  # the physics has a thread on each core: more would wait for each other
        os.environ.setdefault(name, "1")
    if "--version" in sys.argv[1:]:
        print(f"sim2real {metadata.version('sim2real')}")
        return
    try:
        if not sys.argv[1:] or {"--help", "-h"} & set(sys.argv[1:]):
            with suppress(BrokenPipeError):  # the reader, such as `head`, has seen enough
                print(overview(sys.argv[1:]), flush=True)
            return
        if page := page_of(sys.argv[1:]):
            print(open_page(page))
            return
        sys.argv[1:] = precheck(readable(sys.argv[1:]))
        launch()
    except KeyboardInterrupt as stop:
        sys.exit(_say(str(stop) or "interrupted", getattr(stop, "exit_code", 130)))
    except Refused as refused:
        sys.exit(_say(str(refused), 2))
    except Answered as answered:
        sys.exit(answered.args[0])
    except Exception as error:
        sentence = None if os.environ.get(FULL) == "1" else explained(error)
        if sentence is None:
            raise
        sys.exit(_say(sentence, 2))


def page_of(arguments: list[str]) -> str | None:
    """Return the page that `view PAGE.html` opens, without a run's folder; None: another command.

    Raises:
        Sim2RealError: more than a page is given.
    """
    pages = [one for one in arguments[1:] if is_page(one)] if arguments[:1] == ["view"] else []
    if pages and len(arguments) != 2:
        raise Sim2RealError("view accepts one page and no keys: sim2real view PAGE.html")
    return pages[0] if pages else None


def readable(arguments: list[str]) -> list[str]:
    """Return the arguments as Hydra's overrides, if this project's packages are all found.

    Raises:
        ConfigError: a package of the same name that hides ours; see also `as_overrides`.
    """
    from sim2real.config import extensions
    from sim2real.config.arguments import as_overrides, find_shadowing_module
    from sim2real.config.targets import ConfigError

    extensions.activate(extensions.of_arguments(arguments))
    if other := find_shadowing_module():
        raise ConfigError(f"another package hides one of sim2real's: {other}; rename or remove it")
    own = extensions.folder()
    searched = [] if own is None else ["--config-dir", str(own)]
    return searched + as_overrides(extensions.without_option(arguments))


def precheck(arguments: list[str]) -> list[str]:
    """Check the jobs of a command line before Hydra makes a folder for them.

    Returns:
        The arguments, and what a checkpoint among them brings along.

    Raises:
        ConfigError: the first mistake.
        ValueError: a value of a sweep that a constructor refuses.
    """
    from sim2real.config.arguments import options_and_words

    options, given = options_and_words(arguments)
    typed = {option.split("=")[0] for option in options}
    if typed & set(PASSED_ON + OTHER_ROOT):
        return arguments
    from sim2real.config.compose import compose, instantiate, sweep_jobs, used_keys
    from sim2real.config.folders import check_paths_exist
    from sim2real.config.inherited import inherited
    from sim2real.config.optional_keys import with_plus
    from sim2real.config.targets import ConfigError

    sweep, shown = typed & {"--multirun", "-m"}, typed & {"--cfg", "-c"}
    if sweep and shown:
        raise ConfigError("--cfg shows one configuration; leave -m out and give one value each")
    jobs = list(sweep_jobs(given)) if sweep else [given]
    trees = [] if shown else [compose(overrides) for overrides in jobs]  # shown ones may be wrong
    for tree in trees:
        check_paths_exist(tree, used_keys(tree))
    for tree in trees if sweep else []:  # what a constructor refuses is not to come up hours later
        instantiate(tree, Path())
    return options + with_plus(inherited(given), inherited(jobs[0]))


def launch() -> None:
    """Let Hydra make the run's folder and call `job`: once, or for each job of a sweep."""
    import hydra

    from sim2real.config.catalogue import CONF

    before = os.environ.get(FULL, "0")
    os.environ[WANTED] = before
    os.environ[FULL] = "1"  # Hydra then hands its errors on, and `main` says them
    try:
        hydra.main(version_base="1.3", config_path=str(CONF), config_name="config")(job)()
    finally:
        os.environ[FULL] = before


def job(config: Any) -> None:
    """Check, build and run one job in the folder that Hydra made for it.

    A sweep notes the failure of a job and goes on to the next one.

    Raises:
        Refused: for a mistake of the user.
    """
    from hydra.core.hydra_config import HydraConfig
    from hydra.types import RunMode

    from sim2real.config import extensions
    from sim2real.config.sweeps import note_failure

    try:
        extensions.activate(extensions.of_arguments([]))  # in another process of a sweep
        _run(config)
    except Exception as error:
        if os.environ.get(WANTED) == "1":
            raise
        sentence = explained(error)
        if HydraConfig.get().mode == RunMode.MULTIRUN:
            note_failure(error, sentence)
            return
        if sentence is None:
            raise
        _write_to_log(sentence)
        raise Refused(sentence) from None


def _write_to_log(sentence: str) -> None:
    """Write why a run ended into its log file; `main` prints it to the terminal."""
    record = logging.LogRecord("sim2real", logging.ERROR, "", 0, sentence, None, None)
    for handler in logging.getLogger().handlers:
        if isinstance(handler, logging.FileHandler):
            handler.handle(record)


def _run(config: Any) -> None:
    from hydra.core.hydra_config import HydraConfig
    from hydra.types import RunMode

    from envs.quiet import no_log_file
    from sim2real.config.compose import instantiate, save, validate
    from sim2real.config.folders import check_output_is_free
    from sim2real.runs.manifest import write_manifest

    no_log_file()
    hydra = HydraConfig.get()
    out = Path(hydra.runtime.output_dir)
    tree = validate(config)
    check_output_is_free(out, tree)
    write_manifest(out, seed=tree["seed"])
    save(tree, out)
    verb, arguments = instantiate(tree, out)
    logging.raiseExceptions = False  # a log file on a full disk; what else is written says so
    logging.getLogger("sim2real").info("%s in %s", verb.__module__.split(".")[-1], out)
    answer = verb(**arguments)
    logging.getLogger("sim2real").info("results are in %s: %s", out, made_in(out))
    status = getattr(answer, "exit_status", 0)
    if status and hydra.mode != RunMode.MULTIRUN:  # a sweep goes on to its next job
        raise Answered(status)


def made_in(out: Path) -> str:
    """Return the names of what a verb left in a run's folder, what a person reads first."""
    own = {"config.yaml", "manifest.json", "sim2real.log", "timing.csv"}
    names = [path.name + "/" * path.is_dir() for path in out.iterdir()]
    shown = [name for name in names if name not in own and not name.startswith(".")]
    return ", ".join(sorted(shown, key=lambda name: (not name.endswith((".html", ".md")), name)))


def explained(error: Exception) -> str | None:
    """Return the sentence for an error that a user can cause; None for a defect of the program."""
    if isinstance(error, ModuleNotFoundError):  # perhaps hydra's, too
        return lacking(error)
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    from sim2real.config.compose import explain
    from sim2real.runs.errors import DiskError

    if isinstance(error, MemoryError) or any(words in str(error) for words in FULL_MEMORY):
        return f"this needs more memory than there is ({error}); ask for fewer or smaller parts"
    if isinstance(error, OSError) and error.errno in DiskError.USUAL:
        where = f"{error.filename}: " if error.filename else "a file of this run: "
        return f"{where}{error.strerror}; {DiskError.remedy(error)}, then start again"
    if isinstance(error, HydraException | OmegaConfBaseException):
        return str(explain(error, [a for a in sys.argv[1:] if not a.startswith("-")]))
    return str(error) if isinstance(error, ValueError) and _raised_here(error) else None


def lacking(error: ModuleNotFoundError) -> str | None:
    """Return the sentence for a package that is not installed; None for a module of this project.

    An optional package is named with the extra that brings it, any other with the Python that has
    none of them: the one outside this project's environment.
    """
    name = error.name or ""
    if name in EXTRAS:
        return f"this needs {name}; install it with: pip install 'sim2real[{EXTRAS[name]}]'"
    if name.split(".")[0] in ("sim2real", "envs", "hardware"):
        return None
    return (
        f"{sys.executable} has no package {name!r}: use the Python that sim2real is installed in, "
        "such as .venv/bin/python after make setup, or install it here with: pip install ."
    )


def _raised_here(error: BaseException) -> bool:
    """Return whether a statement of this project raised the error: then it is for the user."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    if trace is None:
        return False
    file = trace.tb_frame.f_code.co_filename
    root = Path(__file__).resolve().parent.parent
    own = any(Path(file).resolve().is_relative_to(root / room) for room in ROOMS)
    return own and linecache.getline(file, trace.tb_lineno).lstrip().startswith("raise ")


def _say(sentence: str, status: int) -> int:
    print(f"sim2real: {sentence}", file=sys.stderr)
    return status


def overview(arguments: list[str]) -> str:
    """Return the help: experiments and groups, those of a user's folder included, a line each."""
    from sim2real.config import extensions
    from sim2real.config.catalogue import lines

    extensions.activate(extensions.of_arguments(arguments))
    return "\n".join(lines())


if __name__ == "__main__":
    main()
