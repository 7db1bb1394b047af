"""Ctrl-C ends a command, and what it started."""

import subprocess
import sys

SPARES = """
import os, signal, subprocess, sys, time
from sim2real.runs.stopping import spare_children
spare_children()
wait = "import time; print('started', flush=True); time.sleep(60)"
child = subprocess.Popen([sys.executable, "-c", wait], stdout=subprocess.PIPE)
child.stdout.readline()
os.killpg(0, signal.SIGINT)
try:
    while True:
        time.sleep(0.01)
except KeyboardInterrupt:
    print("interrupted", child.poll())
child.kill()
"""


def test_ctrl_c_spares_the_processes_that_a_command_started() -> None:
    """It comes to all of a terminal's processes, and the first of them ends the others."""
    done = subprocess.run(
        [sys.executable, "-c", SPARES],
        capture_output=True,
        text=True,
        timeout=60,
        start_new_session=True,
    )
    assert done.stdout == "interrupted None\n" and not done.stderr
