"""Train the policies of other libraries that benchmarks.contract checks, and export them as ONNX.

    python -m benchmarks.policies                       # a few minutes each
    python -m benchmarks.policies --only rsl_rl

It needs stable-baselines3 2.9.2, rsl-rl-lib 5.5.1, skrl 2.1.1 and onnxscript; the check needs none.
Stable-Baselines3's has a normalizer outside the network and sees three frames, rsl_rl's holds its
normalizer, skrl's has none. They are trained shortly: they move, and are no random networks.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import yaml

from benchmarks.policies import rsl_rl_train, sb3_train, skrl_train
from benchmarks.policies.tasks import POLICIES, Policy
from sim2real.runs.files import write_text

TRAIN: dict[str, Callable[[Policy, int, Path], dict[str, Any]]] = {
    "stable_baselines3": sb3_train.train,
    "rsl_rl": rsl_rl_train.train,
    "skrl": skrl_train.train,
}


def bare(path: Path) -> None:
    """Take out of a model what the exporter says of the machine that it ran on."""
    import onnx

    model = onnx.load(str(path))
    graph = model.graph
    parts = [model, graph, *graph.node, *graph.input, *graph.output, *graph.value_info]
    for part in [*parts, *graph.initializer]:
        part.doc_string = ""
        del part.metadata_props[:]
    onnx.save(model, str(path))


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, train, and write each policy and its description."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.policies",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--only", nargs="+", choices=list(TRAIN), default=list(TRAIN), help="default: all")
    add("--frames", type=int, default=60_000, help="of each training (default: %(default)s)")
    chosen = parser.parse_args(arguments)
    if chosen.frames < 1:
        parser.error("--frames must be at least 1")
    for library in chosen.only:
        one = POLICIES[library]
        description = TRAIN[library](one, chosen.frames, one.file)
        bare(one.file)
        text = yaml.safe_dump(description, sort_keys=False, default_flow_style=None, width=100)
        head = (
            f"# what the policy of {library} sees and does; made by python -m benchmarks.policies\n"
        )
        write_text(one.observation, head + text)
        print(f"{library}: {one.file.stat().st_size} bytes")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
