"""Processes of a sweep's jobs."""

import os
import subprocess
import sys

STARTS = """
import sys
seen = []
sys.addaudithook(lambda event, _: seen.append(event) if event == "subprocess.Popen" else None)
import mujoco
print(len(seen))
"""
SWEEP = f"""
import subprocess, sys
from sim2real.config.sweeps import find_glfw
find_glfw()
subprocess.run([sys.executable, "-c", {STARTS!r}])
"""


def test_a_job_starts_no_process_that_looks_for_a_library() -> None:
    """The sweep has found it; Ctrl-C would end the job before that process has its input."""
    alone = {name: value for name, value in os.environ.items() if name != "PYGLFW_LIBRARY"}
    command = [sys.executable, "-c", SWEEP]
    done = subprocess.run(command, capture_output=True, text=True, env=alone)
    assert (done.stdout, done.stderr) == ("0\n", "")
