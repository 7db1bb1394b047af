"""The engine is silent in a block, in however many threads, and as loud as before after it."""

import os
import subprocess
import sys
import threading
from pathlib import Path

from mujoco import MjLogConfig

from envs.quiet import quiet_engine


def test_blocks_of_several_threads_overlap() -> None:
    """A block that ends does not wake the engine while another thread's block still runs."""
    before = MjLogConfig.get().logto_file
    inside, leave = threading.Event(), threading.Event()

    def other() -> None:
        with quiet_engine():
            inside.set()
            leave.wait(10)

    thread = threading.Thread(target=other)
    with quiet_engine():
        thread.start()
        assert inside.wait(10)
    assert not MjLogConfig.get().logto_file
    leave.set()
    thread.join()
    assert MjLogConfig.get().logto_file == before


def test_no_log_file_is_written(tmp_path: Path) -> None:
    """A model that diverges outside any quiet block leaves nothing in the working directory."""
    code = (
        "import mujoco\nfrom envs.quiet import no_log_file\nno_log_file()\n"
        "model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><body><freejoint/>'\n"
        "  '<geom size=\".1\"/></body></worldbody></mujoco>')\n"
        "data = mujoco.MjData(model)\ndata.qvel[:] = 1e12\n"
        "for _ in range(10): mujoco.mj_step(model, data)\nassert data.warning.number.any()\n"
    )
    root = Path(__file__).resolve().parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, check=True)
    assert list(tmp_path.iterdir()) == []
