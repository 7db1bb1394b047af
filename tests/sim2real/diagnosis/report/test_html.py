"""report.html: what a person reads of a diagnosis, without a network and without surprises."""

from __future__ import annotations

import html
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from sim2real.diagnosis.report.html import render, write_html
from sim2real.diagnosis.schema import (
    Band,
    Cause,
    Equivalent,
    Evidence,
    Finding,
    GapNumbers,
    Regime,
    Report,
    Rung,
    SingleFit,
    Trace,
    Unexplained,
    Where,
)

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chromium-headless-shell")
EVIL = "</script><script>alert('x')</script>&"


def trace(joint: str) -> Trace:
    """Return 12 s of a joint whose first half was fitted."""
    time = np.arange(0, 12, 0.02)
    measured = np.sin(time)
    held = time > 6
    return Trace(
        "a.csv", 0, joint, "rad", time, measured, 0.9 * measured, 0.99 * measured, 0.002, held
    )


@pytest.fixture
def report() -> Report:
    """Return a report with something in every part of the page."""
    causes = (
        Cause(
            *("backlash", "elbow", "link", 0.049, (0.045, 0.053), "rad", {}, 0.97, 0.8),
            equivalent=(Equivalent("joint_compliance", "elbow"),),
        ),
        Cause("command_delay", None, None, 0.018, (0.017, 0.02), "s", {}, 0.9, 0.15),
    )
    evidence = Evidence(
        traces=(trace("elbow"), trace("shoulder")),
        ladder=(
            Rung("model as given", 0.07, (0.06, 0.08)),
            Rung("+ backlash", 0.02, (0.018, 0.022)),
            Rung("+ command_delay", 0.005, (0.004, 0.006)),
            Rung("noise floor", 0.002, (0.002, 0.002)),
        ),
        singles=tuple(
            SingleFit("armature", f"joint{k}", None, 0.01, "kg·m²", 0.5 - 0.06 * k, (-0.1, 0.6))
            for k in range(10)
        ),
        bands=(Band("elbow", 0.0, 1.0, 0.06, 0.004, 0.001),),
        inputs={"logs": ["a.csv"], "models": ["arm.xml"], "seed": 3, "versions": {"mujoco": "4"}},
    )
    return Report(
        verdict="explained",
        gap=GapNumbers("rad", 0.07, 0.005, 0.002, 0.956, (0.93, 0.97), True),
        where=(
            Where("elbow", 0.8, 0.09, 0.006, (Regime("reversal", 0.5), Regime("hold", 0.25))),
            Where("shoulder", 0.2, 0.02, 0.003, (Regime("reversal", 0.1),)),
        ),
        causes=causes,
        unexplained=Unexplained(0.04, "slow, at the shoulder"),
        preflight=(
            Finding("sign", "wrist", "it moves the other way", "negate qpos.wrist"),
            Finding("quantization", "elbow", "It comes in steps.", "Nothing to mend."),
        ),
        numerics={"timestep": "ok", "solver": "halves the gap"},
        next_experiment="ramps without load",
        seconds=31.0,
        evidence=evidence,
    )


class _Text(HTMLParser):
    """Collects tags and the text that a reader sees."""

    def __init__(self) -> None:
        super().__init__()
        self.words: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        if self.tags and self.tags[-1][0] not in ("script", "style"):
            self.words.append(data)


def read(page: str) -> tuple[str, list[tuple[str, dict[str, str | None]]]]:
    """Return the text and the tags of a page."""
    parser = _Text()
    parser.feed(page)
    return " ".join(" ".join(parser.words).split()), parser.tags


def test_it_says_all_of_the_report(report: Report) -> None:
    """Verdict, figures, places, causes, equivalents, residue, findings, next step, command."""
    text, _ = read(render(report))
    for words in (
        "Backlash at elbow and command delay explain 96 % of the gap.",
        "70.0 mrad",
        "93 % to 97 %",
        "49.0 mrad (2.81°)",
        "45.0 to 53.0 mrad",
        "cannot tell it from joint compliance at elbow",
        "nothing follows for a fixed angle after each reversal",
        "40 %",  # the elbow's 80 %, half of it at reversals
        "it has a structure: slow, at the shoulder",
        "Solver: halves the gap",
        "sign at wrist: it moves the other way negate qpos.wrist",
        "What the sensors are like It comes in steps. Nothing to mend.",
        "Record: ramps without load",
        "Images are not diagnosed yet.",
        "python -m sim2real run=diagnose log=a.csv model=arm.xml seed=3",
        "versions: mujoco 4",
        "The other 2",
    ):
        assert words in text.replace("\xa0", " "), words


def test_it_needs_no_network(report: Report) -> None:
    """Nothing is loaded: no address, no source, and a policy that forbids both."""
    page = render(report).replace("http://www.w3.org/2000/svg", "")  # a name, not an address
    _, tags = read(page)
    assert not re.search(r"""(src|href)\s*=|url\(|@import|https?://""", page)
    policy = next(a["content"] for t, a in tags if a.get("http-equiv") == "Content-Security-Policy")
    assert policy is not None and policy.startswith("default-src 'none'")


def test_names_from_files_stay_text(report: Report) -> None:
    """A joint, log, place, finding or input with markup in its name cannot become markup."""
    where = (replace(report.where[0], joint=EVIL),)
    causes = (replace(report.causes[0], where=EVIL, extra={EVIL: EVIL}),)
    evidence = replace(
        report.evidence,
        traces=(replace(trace(EVIL), log=EVIL),),
        ladder=(replace(report.evidence.ladder[0], label=EVIL),) * 3,
        inputs={"logs": [EVIL], EVIL: EVIL},
    )
    findings = (Finding(EVIL, EVIL, EVIL, EVIL),)
    evil = replace(report, where=where, causes=causes, evidence=evidence, preflight=findings)
    page = render(replace(evil, next_experiment=EVIL, numerics={EVIL: EVIL}))
    _, tags = read(page)
    assert [t for t, _ in tags].count("script") == [t for t, _ in read(render(report))[1]].count(
        "script"
    )
    assert "<script>alert" not in page


def test_a_report_without_a_gap_says_so(report: Report) -> None:
    """No causes, no closed share, and no empty headings."""
    gap = GapNumbers("rad", 0.002, None, 0.002, None, None, True)
    quiet = replace(
        report, verdict="no_gap", gap=gap, causes=(), preflight=(), next_experiment=None
    )
    text, _ = read(render(quiet).replace("\xa0", " "))
    assert "Simulation and robot agree" in text
    assert "There is nothing to explain." in text
    assert "Gap after" not in text and "Look at this first" not in text


def test_a_gap_without_a_cause_has_no_line_after(report: Report) -> None:
    """What was not corrected is not drawn as if it were; the residue is described."""
    traces = tuple(replace(t, corrected=t.nominal) for t in report.evidence.traces)
    gap = replace(report.gap, after=report.gap.before, closed=0.0, closed_ci=(0.0, 0.0))
    left = Unexplained(1.0, "fast, at the elbow")
    evidence = replace(report.evidence, traces=traces, ladder=report.evidence.ladder[::3])
    lost = replace(
        report, verdict="unexplained", gap=gap, causes=(), unexplained=left, evidence=evidence
    )
    page = render(lost)
    text, _ = read(page.replace("\xa0", " "))
    assert "There is a gap, and no effect that is known here explains it." in text
    assert "No effect that was tried brings it nearer" in text
    assert "100 % of the gap stays, and it has a structure: fast, at the elbow." in text
    assert "Gap after" not in text and "with the causes" not in text
    assert 'class="corrected"' not in page and '"corrected":' not in page


def test_a_report_that_was_read_has_a_page(report: Report) -> None:
    """Without evidence the pictures are left out, the answer stays."""
    bare = Report.from_json(report.to_json())
    text, tags = read(render(bare))
    assert "Backlash at elbow" in text
    assert "canvas" not in {a.get("id") for _, a in tags}


def test_it_stays_small(report: Report, tmp_path: Path) -> None:
    """Of an hour of twelve joints the recordings with the largest gaps are there, thinned."""
    time = np.arange(0, 3600, 0.02)
    wave = np.sin(time)
    long = tuple(
        Trace("a.csv", 0, f"j{k}", "rad", time, wave, wave + k, wave, 0.001, time > 1800)
        for k in range(12)
    )
    path = write_html(
        tmp_path / "report.html", replace(report, evidence=replace(report.evidence, traces=long))
    )
    page = path.read_text(encoding="utf-8")
    assert path.stat().st_size < 6e6
    assert "Of 12 recordings these are the 5 with the largest gaps." in page
    assert re.findall(r'"label": "(j\d+) ', page) == ["j11", "j10", "j9", "j8", "j7"]


@pytest.fixture
def browser() -> str:
    """Return a Chromium; skips where there is none."""
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip(f"no browser to look with; one of {', '.join(BROWSERS)} would do")
    return found


def look(browser: str, page: Path) -> tuple[str, str]:
    """Return the page after its script ran, and what the browser complained about."""
    command = [
        *(browser, "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr"),
        *("--window-size=1200,900", f"--user-data-dir={page.parent / 'profile'}"),
        *("--virtual-time-budget=3000", "--dump-dom", page.as_uri()),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    return done.stdout, "\n".join(x for x in done.stderr.splitlines() if "CONSOLE" in x)


PROBE = """<script>
const first = () => document.querySelector("#canvas .t").textContent, before = first();
document.getElementById("canvas").dispatchEvent(new KeyboardEvent("keydown", { key: "+" }));
const wide = document.documentElement.scrollWidth;
document.title = `${wide} wide, from ${before} to ${first()} s`;
</script>"""
FRAME = """<iframe id="frame" width="{}" height="900" style="border: 0" srcdoc="{}"></iframe>
<script>
addEventListener("load", () => {{
  const page = document.getElementById("frame").contentDocument;
  document.documentElement.innerHTML = page.documentElement.innerHTML;
}});
</script>"""  # not every Chromium makes a window as narrow as a phone


@pytest.mark.render
@pytest.mark.parametrize("width", [390, 1200])
def test_a_real_browser_shows_it(report: Report, browser: str, tmp_path: Path, width: int) -> None:
    """Chromium runs the script without a complaint, keys work, nothing is wider than a phone."""
    long = replace(trace("elbow"), log="a_recording_with_a_long_name" * 3 + ".parquet")
    evidence = replace(report.evidence, traces=(long, *report.evidence.traces[1:]))
    text = render(replace(report, evidence=evidence)).replace("</body>", PROBE + "</body>")
    page = tmp_path / "report.html"
    page.write_text(FRAME.format(width, html.escape(text)), encoding="utf-8")
    seen, complaints = look(browser, page)
    assert complaints == ""
    found = re.search(r"<title>(\d+) wide, from (\S+) to (\S+) s</title>", seen)
    assert found is not None and int(found[1]) <= width
    assert float(found[2]) == 0 and float(found[3]) > 2  # the key + zooms in
    _, tags = read(seen)
    assert "hidden" not in next(a for _, a in tags if a.get("id") == "browser")
    assert [t for t, _ in tags].count("option") == 2
    lines = {a.get("class") for t, a in tags if t == "path"}
    assert {"measured", "nominal", "corrected"} <= lines
