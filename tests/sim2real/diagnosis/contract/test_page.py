"""`contract.html` in a real browser."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from sim2real.diagnosis.contract.check import check_contract
from tests.sim2real.diagnosis.contract.walk import described, walk

pytestmark = pytest.mark.render


def shown(browser: str, page: Path, width: int = 1200) -> tuple[str, str]:
    """Return the page after the browser has laid it out, and what it complained about."""
    command = [
        *(browser, "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr"),
        *(f"--window-size={width},900", f"--user-data-dir={page.parent / 'profile'}"),
        *("--virtual-time-budget=5000", "--dump-dom", page.as_uri()),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=True)
    return done.stdout, "".join(line for line in done.stderr.splitlines() if "CONSOLE" in line)


def test_it_shows_what_is_wrong_and_what_to_do(browser: str, tmp_path: Path) -> None:
    """Fault, place and fix are there to be read; names from files are text; nothing is fetched."""
    log, actor = walk(see={"gyro": np.degrees})
    about = described(tmp_path / "OBS.yaml", name='<img src="x" onerror="window.evil=1">')
    answer = check_contract([log], about, actor)
    answer.write(tmp_path)
    page = tmp_path / "contract.html"
    probe = """<script>
    const box = (name) => document.querySelector(name).getBoundingClientRect();
    document.title = JSON.stringify({ rows: document.querySelectorAll("tr").length,
      width: document.documentElement.scrollWidth <= innerWidth, evil: window.evil ?? null,
      images: document.images.length, seen: box(".verdict").height > 10 && box(".fix").width > 50,
      fetched: performance.getEntriesByType("resource").length });
    </script></body>"""
    page.write_text(page.read_text().replace("</body>", probe))
    text, complaints = shown(browser, page)
    assert complaints == ""
    title = text.split("<title>", 1)[1].split("</title>", 1)[0]
    assert '"width":true,"evil":null,"images":0,"seen":true,"fetched":0' in title
    assert "gyro is in degrees" in text
    assert answer.findings[0].fix in text
