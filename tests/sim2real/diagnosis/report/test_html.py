"""report.html: what a person reads of a diagnosis, without a network and without surprises."""

import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.evidence import Trace
from sim2real.diagnosis.report.html import render, write_html
from sim2real.diagnosis.report.provenance import links
from sim2real.diagnosis.schema import Equivalent, Finding, GapMetrics, Report, Unexplained
from tests.sim2real.diagnosis.report import sample

NO_ANSWERS = {"asked": 0, "lost": 0, "late": 0, "stale": 0}
EVIL = "</script><script>alert('x')</script>&"


@pytest.fixture
def report() -> Report:
    """Return a report with something in every part of the page."""
    return sample.report()


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
        "the link lags by a fixed angle after each reversal",
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
        "1 backlash at elbow (link side) 1.00 −0.62 2 command delay −0.62 1.00",
        "armature at joint0 0.0100 kg·m² 50 % -10 % to 60 %",
        "Made 2026-11-22 10:00+00:00 Robot arm2 With mujoco 4 SHA-256 of a.csv 0123456789ab",
    ):
        assert words in text.replace("\xa0", " "), words


def test_it_shows_the_channels_that_nothing_was_fitted_to(report: Report) -> None:
    """Before, after and their noise; none of it where a log has positions alone."""
    page = render(report)
    (row,) = [line for line in page.splitlines() if "<code>qvel.elbow</code>" in line]
    text = re.sub(r"<[^>]*>", " ", row).replace("\N{NO-BREAK SPACE}", " ").split()
    assert text == ["qvel.elbow", "0.200", "rad/s", "0.0200", "rad/s", "0.0100", "rad/s"]
    bare = replace(report, evidence=replace(report.evidence, channels=()))
    assert "Channels that nothing" not in render(bare)


def test_it_shows_the_policy_in_both_simulators(report: Report) -> None:
    """The sentence, a track for each world and measure, returns; nothing without a policy."""
    text, tags = read(render(report))
    for words in (
        "The corrected simulator is nearer to the robot than the one as given",
        "Sliced Wasserstein distance",
        "0.54 0.53 to 0.55",
        "Return of an episode",
        "−0.006 −0.007 to −0.005",
        "32 episodes in each simulator; the robot has 6",
    ):
        assert words in text
    without, fewer = read(render(replace(report, closed_loop=None)))
    assert "The policy in the corrected simulator" not in without
    tracks = [sum(a.get("class") == "track" for _, a in some) for some in (tags, fewer)]
    assert tracks[0] - tracks[1] == 9  # three worlds, by two distances and the return


def test_it_shows_the_link_of_each_log(report: Report) -> None:
    """Of logs that tell it: answers of each servo, periods in ms, overruns, the score."""
    servos = {"hip": {"asked": 900, "lost": 7, "late": 8, "stale": 9}, "knee": dict(NO_ANSWERS)}
    told = {"period": {"p50": 0.01, "p90": 0.0104, "p99": 0.02}, "overruns": 13, "servos": servos}
    score = {"score": 0.618, "go": True, "reason": "narrow"}
    silent = {"period": {}, "overruns": 0, "servos": {"hip": NO_ANSWERS}, "score": None}
    columns = {name: np.arange(2.0) for name in ("time", "ctrl.hip", "qpos.hip")}
    columns["episode"] = np.zeros(2)
    logs = [
        Log(columns, {"link": told | {"score": score}}, Path("runs/a.csv")),
        Log(columns, {"link": silent}, Path("b.csv")),
        Log(columns, {}, Path("c.csv")),
    ]
    inputs = {**report.evidence.inputs, "link": links(logs)}
    shown = replace(report, evidence=replace(report.evidence, inputs=inputs))
    text, _ = read(render(shown))
    assert "a.csv hip 900 7 8 9 10.0, 10.4, 20.0 13 0.62 a.csv knee 0 0 0 0" in text
    assert "b.csv hip 0 0 0 0 –, –, – 0 –" in text
    assert "The link of the recordings" not in read(render(report))[0]


def test_it_needs_no_network(report: Report) -> None:
    """Nothing is loaded: no address, no source, and a policy that forbids both."""
    page = render(report).replace("https://github.com/leeoniya/uPlot", "")  # says whose it is
    _, tags = read(page)
    links = [a["href"] for _, a in tags if "href" in a]
    assert links and all(link == "#browser" for link in links)
    assert not re.search(r"""src\s*=|url\(|@import|https?://""", page)
    policy = next(a["content"] for t, a in tags if a.get("http-equiv") == "Content-Security-Policy")
    assert policy is not None and policy.startswith("default-src 'none'")


def test_names_from_files_stay_text(report: Report) -> None:
    """A joint, log, place, finding or input with markup in its name cannot become markup."""
    where = (replace(report.where[0], joint=EVIL),)
    causes = (replace(report.causes[0], where=EVIL, extra={EVIL: EVIL}),)
    evidence = replace(
        report.evidence,
        traces=(replace(sample.trace(EVIL), log=EVIL),),
        signals=(replace(sample.signal("command", EVIL), log=EVIL, actuator=EVIL, joint=EVIL),),
        ladder=(replace(report.evidence.ladder[0], label=EVIL),) * 3,
        inputs={"logs": [EVIL], EVIL: EVIL, "robots": [EVIL], "sha256": {EVIL: EVIL}},
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
    gap = GapMetrics("rad", 0.002, None, 0.002, None, None, True)
    quiet = replace(
        report, verdict="no_gap", gap=gap, causes=(), preflight=(), next_experiment=None
    )
    text, _ = read(render(quiet).replace("\xa0", " "))
    assert "Simulation and robot agree" in text
    assert "There is nothing to explain." in text
    assert "Gap after" not in text and "Look at this first" not in text


def test_fitted_values_are_shown_and_not_called_causes(report: Report) -> None:
    """The badge, the headline and the heading say that it is a fit; the values are there."""
    many = tuple(
        replace(report.causes[0], effect="position_gain", where=f"joint{n}", extra={})
        for n in range(6)
    )
    shared = replace(report.causes[0], effect="coulomb_friction", where=None, shared=True, extra={})
    evidence = replace(report.evidence, correlations=np.eye(7))
    fitted = replace(report, verdict="fitted", causes=(), fitted=(*many, shared), evidence=evidence)
    text, _ = read(render(fitted).replace("\xa0", " "))
    assert "Fitted, not explained" in text
    assert "7 fitted values close" in text
    assert "position gain at 6 places and Coulomb friction at all joints alike." in text
    assert "Fitted values" in text and "Position gain at joint5" in text
    assert "Gap after" in text and "explain " not in text


def test_what_no_recording_parts_is_said_apart(report: Report) -> None:
    """Another recording may tell a spring from play; none tells one delay from the other."""
    others = (Equivalent("joint_compliance", "elbow"), Equivalent("observation_delay", None, True))
    causes = (replace(report.causes[0], equivalent=others), *report.causes[1:])
    text, _ = read(render(replace(report, causes=causes)).replace("\xa0", " "))
    assert "These recordings cannot tell it from joint compliance at elbow:" in text
    assert "It predicts the same as observation delay:" in text


def test_a_gap_without_a_cause_has_no_line_after(report: Report) -> None:
    """What was not corrected is not drawn as if it were; the residue is described."""
    traces = tuple(replace(t, corrected=t.nominal, subsets={}) for t in report.evidence.traces)
    gap = replace(report.gap, after=report.gap.before, closed=0.0, closed_ci=(0.0, 0.0))
    left = Unexplained(1.0, "fast, at the elbow")
    evidence = replace(report.evidence, traces=traces, ladder=report.evidence.ladder[::3])
    lost = replace(
        report, verdict="unexplained", gap=gap, causes=(), unexplained=left, evidence=evidence
    )
    page = render(lost)
    text, _ = read(page.replace("\xa0", " "))
    assert "There is a gap, and no known effect explains it." in text
    assert "No effect that was tried reduces the error" in text
    assert "100 % of the gap remains, and it has a structure: fast, at the elbow." in text
    assert "Gap after" not in text and "with the causes" not in text
    assert 'class="corrected"' not in page and '"all":' not in page


def test_a_report_that_was_read_has_a_page(report: Report) -> None:
    """Without evidence the pictures are left out, the answer stays."""
    bare = Report.from_json(report.to_json())
    text, tags = read(render(bare))
    assert "Backlash at elbow" in text
    assert "browser" not in {a.get("id") for _, a in tags}


def test_it_stays_small(report: Report, tmp_path: Path) -> None:
    """Of hours of twelve joints the recordings with the largest gaps are there, thinned."""
    time = np.arange(0, 3600, 0.02)
    wave = np.sin(time)
    long = tuple(
        Trace(f"{k}.csv", 0, f"j{j}", "rad", time, wave, wave + k, wave, 0.001)
        for k in range(4)
        for j in range(6)
    )
    path = report.save_html(tmp_path / "report.html")
    evidence = replace(report.evidence, traces=long, signals=())
    path = write_html(tmp_path / "report.html", replace(report, evidence=evidence))
    page = path.read_text(encoding="utf-8")
    assert path.stat().st_size < 6e6
    assert "Of 4 recordings these are the 2 with the largest gaps." in page
    assert re.findall(r'"label": "(\d.csv), ', page) == ["3.csv", "2.csv"]


def test_it_says_that_axes_of_errors_may_be_logarithmic(report: Report) -> None:
    """Beside the small pictures and beside the whole recordings, whose axes bend alike."""
    time = np.arange(0, 6, 0.02)
    far = Trace("a.csv", 0, "elbow", "rad", time, np.sin(time), np.sin(time) + 1, 0 * time, 0.001)
    evidence = replace(report.evidence, traces=(far,), signals=())
    text, _ = read(render(replace(report, evidence=evidence)))
    assert "go far beyond that band, their axis is logarithmic outside it" in text
    assert "far beyond twice the noise floor are on an axis that is logarithmic outside it" in text


def test_a_notebook_shows_it_in_a_frame(report: Report) -> None:
    """The page is an attribute of a frame that may run scripts and nothing else of the notebook."""
    [(tag, attributes)] = read(report._repr_html_())[1]
    assert tag == "iframe" and attributes["srcdoc"] == render(report)
    assert attributes["sandbox"] == "allow-scripts allow-downloads"


def test_the_command_is_the_one_that_was_given(report: Report) -> None:
    """What started the run is what the page says, not something like it."""
    given = "sim2real +experiment=diagnose_demo seed=7"
    inputs = {**report.evidence.inputs, "command": given}
    text, _ = read(render(replace(report, evidence=replace(report.evidence, inputs=inputs))))
    assert text.count(given) == 1 and "run=diagnose" not in text
