"""How far apart are a recording and its model, joint by joint? Nothing is fitted.

python examples/replay_a_log.py [LOG.csv MODEL.xml]      # without: the recording of the demo
"""

from __future__ import annotations

import sys
from pathlib import Path

import envs
from hardware.log import read_log
from sim2real.diagnosis.data.recording import load_model
from sim2real.diagnosis.data.replay import measure

ASSETS = Path(envs.__file__).parent / "assets"


def main(log: str, model: str) -> None:
    """Print each joint's root-mean-square error [mrad]."""
    recording = read_log(log)
    for joint, error in measure(recording, load_model(recording, Path(model))).errors().items():
        print(f"{joint}: {1000 * error['rmse']:.1f} mrad")


if __name__ == "__main__":
    main(*(sys.argv[1:] or [str(ASSETS / "demo" / "arm2.csv"), str(ASSETS / "arm2.xml")]))
