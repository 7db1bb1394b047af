"""What needs more memory than there is gets refused with both sizes, before anything is made."""

import resource
import subprocess
import sys
from pathlib import Path

import mujoco
import pytest

from envs import memory
from envs.errors import EnvsError
from envs.memory import available, check_memory, format_bytes, row_bytes
from envs.plant import Plant

XML = """<mujoco><worldbody><body><joint name="a"/><geom size=".1"/></body></worldbody>
<actuator><motor joint="a"/></actuator></mujoco>"""


def test_rows_that_do_not_fit_are_refused_with_both_sizes() -> None:
    """A thousand million simulations: needed and free, and what to ask for."""
    spec = mujoco.MjSpec.from_string(XML)
    with pytest.raises(EnvsError, match=r"1000000000 .* need about 1\d\d TB .* are free; .*fewer"):
        Plant(spec, num_rows=10**9)


def test_it_is_about_what_a_batch_takes() -> None:
    """Within a factor of two of what the system counts for a thousand rows of a walker."""
    root = Path(__file__).resolve().parents[2]
    code = (
        "import mujoco, resource; from mujoco.batch import Batch\n"
        "model = mujoco.MjModel.from_xml_path('envs/assets/quad8.xml')\n"
        "used = lambda: int(open('/proc/self/statm').read().split()[1]) * resource.getpagesize()\n"
        "before = used(); batch = Batch(model, 1000, 1, True); print((used() - before) / 1000)"
    )
    if not memory.MEMINFO.exists():
        pytest.skip("needs /proc")
    made = subprocess.run(
        [sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True
    )
    model = mujoco.MjModel.from_xml_path(str(root / "envs/assets/quad8.xml"))
    assert 0.5 < float(made.stdout) / row_bytes(model) < 2


def test_what_is_free_is_the_least_of_machine_and_container(tmp_path: Path, monkeypatch) -> None:
    """A container's limit counts where it is lower; without either it is the machine's memory."""
    meminfo = tmp_path / "meminfo"
    meminfo.write_text("MemTotal: 8000 kB\nMemAvailable: 5000 kB\n")
    monkeypatch.setattr(memory, "MEMINFO", meminfo)
    monkeypatch.setattr(memory, "CGROUP", tmp_path)
    assert available() == 5_120_000
    (tmp_path / "memory.max").write_text("4000000\n")
    (tmp_path / "memory.current").write_text("1000000\n")
    assert available() == 3_000_000
    stat = "anon 500000\ninactive_file 300000\nactive_file 100000\n"
    (tmp_path / "memory.stat").write_text(stat)
    assert available() == 3_400_000, "files that were read are given up"
    (tmp_path / "memory.max").write_text("max\n")
    assert available() == 5_120_000
    meminfo.unlink()
    assert available() >= resource.getpagesize()


def test_a_limit_of_the_shell_counts() -> None:
    """`ulimit -v`: the process's own address space is taken off."""
    code = "from envs.memory import available; print(available())"
    limit = 2 * 1024**3
    made = subprocess.run(
        [sys.executable, "-c", code],
        cwd=Path(__file__).resolve().parents[2],
        capture_output=True,
        text=True,
        check=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)),
    )
    assert 0 < int(made.stdout) < limit


def test_what_fits_passes_and_sizes_are_words() -> None:
    """Nothing is said of a megabyte; 3.2e9 bytes are 3.2 GB."""
    check_memory(1e6, "10 rows", "fewer rows")
    assert [format_bytes(x) for x in (5.0, 3.2e9, 1.4e17)] == ["5 B", "3.2 GB", "140 PB"]
