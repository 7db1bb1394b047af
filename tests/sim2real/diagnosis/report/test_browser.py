"""The page in a real browser: it is driven by a script and tells what it saw."""

import html
import json
import subprocess
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from hardware.assets import ASSETS
from sim2real.diagnosis.report.html import render
from sim2real.diagnosis.schema import Report
from tests.sim2real.diagnosis.report.sample import report, trace

pytestmark = pytest.mark.render

FRAME = """<!doctype html><iframe id="frame" width="{}" height="900" style="border: 0"
 srcdoc="{}"></iframe><pre id="told"></pre>
<script>
addEventListener("message", (event) => {{
  document.getElementById("told").textContent = event.data;
}});
</script>"""  # not every Chromium makes a window as narrow as a phone

HELPERS = Path(__file__).with_name("driver.js").read_text(encoding="utf-8")


def drive(
    browser: str,
    folder: Path,
    script: str,
    width: int = 1100,
    dark: bool = False,
    shown: Report | None = None,
) -> Any:
    """Return what a script that runs in the page returns; the browser must not complain.

    Args:
        browser: the program.
        folder: for the page and the browser's own files.
        script: the body of an asynchronous function.
        width: of the page [px].
        dark: whether the system says that it is dark.
        shown: the report; None for the sample.
    """
    probe = f"""<script>{HELPERS}
    (async () => {{ await later(200); {script} }})()
      .then((told) => parent.postMessage(JSON.stringify({{ told }}), "*"))
      .catch((error) => parent.postMessage(JSON.stringify({{ error: error.stack }}), "*"));
    </script>"""
    text = render(shown or sample()).replace("</body>", probe + "</body>")
    page = folder / "report.html"
    page.write_text(FRAME.format(width, html.escape(text)), encoding="utf-8")
    command = [
        *(browser, "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr"),
        *("--window-size=1200,900", f"--user-data-dir={folder / 'profile'}"),
        *("--virtual-time-budget=200000", "--dump-dom"),
        *(["--blink-settings=preferredColorScheme=0"] if dark else []),
        page.as_uri(),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200, check=True)
    assert [line for line in done.stderr.splitlines() if "CONSOLE" in line] == []
    told = done.stdout.rsplit('<pre id="told">', 1)[1].split("</pre>", 1)[0]
    answer = json.loads(html.unescape(told))
    assert "error" not in answer, answer["error"]
    return answer["told"]


@pytest.fixture
def page(browser: str, tmp_path: Path) -> Any:
    """Return what drives the page in a browser."""
    return partial(drive, browser, tmp_path)


def sample() -> Report:
    """Return a report with a robot, and with a log whose name is too long for a phone."""
    made = report()
    inputs = {**made.evidence.inputs, "models": [str(ASSETS / "arm2.xml")]}
    long = replace(trace("elbow"), log="a_recording_with_a_long_name" * 3 + ".parquet")
    traces = (*made.evidence.traces, long)
    return replace(made, evidence=replace(made.evidence, traces=traces, inputs=inputs))


def test_one_cursor_reads_all_joints(page: Any) -> None:
    """Pointing at one plot shows the values of every line at that moment, in all plots."""
    told = page(
        """
        mouse("mouseenter", over(0), 0.25, 0.5); mouse("mousemove", over(0), 0.25, 0.5);
        await later();
        const crosses = all(".u-cursor-x").map((line) => line.style.transform);
        return { titles: titles(), seen: seen(), moment: moment(), crosses };
        """,
    )
    assert told["titles"] == [
        *("elbow, rad", "elbow, error, mrad", "shoulder, rad", "shoulder, error, mrad"),
    ]
    assert told["moment"] == pytest.approx(3.0, abs=0.1)
    assert "" not in told["seen"]
    measured, nominal, corrected = (float(text.replace("−", "-")) for text in told["seen"][:3])
    assert nominal == pytest.approx(0.9 * measured, abs=2e-3)
    assert corrected == pytest.approx(0.99 * measured, abs=2e-3)
    assert len(set(told["crosses"])) == 1


def test_it_zooms_and_pans(page: Any) -> None:
    """Drag, wheel, keys, one finger and two: all plots follow; double-click shows all again."""
    told = page(
        """
        const found = { all: await span() };
        drag(over(0), [0.25, 0.5], [0.5, 0.52]); await later(); found.drag = await span(3);
        key("0"); await later(); found.zero = await span();
        key("+"); await later(); found.plus = await span();
        key("ArrowLeft"); await later(); found.left = await span();
        mouse("dblclick", over(0), 0.5, 0.5); await later(); found.double = await span();
        const clientX = over(1).getBoundingClientRect().left + 1;
        const wheel = (more) => over(1).dispatchEvent(new WheelEvent("wheel",
          { bubbles: true, cancelable: true, deltaY: -300, clientX, ...more }));
        found.scrolled = wheel({}); await later(); found.unasked = await span();
        found.stopped = !wheel({ ctrlKey: true }); await later(); found.wheel = await span();
        key("0"); await later();
        touch("pointerdown", over(0), 1, 0.4); touch("pointerdown", over(0), 2, 0.6);
        touch("pointermove", over(0), 1, 0.3); touch("pointermove", over(0), 2, 0.7);
        touch("pointerup", over(0), 1, 0.3); touch("pointerup", over(0), 2, 0.7);
        await later(); found.pinch = await span();
        touch("pointerdown", over(0), 3, 0.5); touch("pointermove", over(0), 3, 0.4);
        touch("pointercancel", over(0), 3, 0.4); touch("pointermove", over(0), 3, 0.1);
        await later(); found.pan = await span();
        touch("pointerdown", over(0), 4, 0.5); touch("pointerup", over(0), 4, 0.5);
        await later(); found.tap = moment(); found.values = seen()[0];
        return found;
        """,
    )
    whole = pytest.approx([0, 11.98], abs=0.05)
    for name in ("all", "zero", "double", "unasked"):
        assert told[name] == whole, name
    assert told["drag"] == pytest.approx([3.0, 6.0], abs=0.1)
    start, end = told["plus"]
    assert end - start == pytest.approx(0.6 * 11.98, rel=0.02)
    assert start - told["left"][0] == pytest.approx(0.2 * (end - start), rel=0.1)
    assert told["scrolled"] and told["stopped"]
    assert told["wheel"][0] == pytest.approx(0, abs=0.05) and told["wheel"][1] < 8
    start, end = told["pinch"]
    assert end - start == pytest.approx(11.98 / 2, rel=0.05)
    assert told["pan"][0] - start == pytest.approx(0.1 * (end - start), rel=0.15)
    assert told["pan"][1] - told["pan"][0] == pytest.approx(end - start, rel=0.02)
    assert told["tap"] == pytest.approx(sum(told["pan"]) / 2, abs=0.1) and told["values"]


def test_causes_joints_and_signals_are_switched(page: Any) -> None:
    """Without a cause the line is that of the others; joints, errors and currents come and go."""
    told = page(
        """
        const tick = async (host, n) => { all(`#${host} input`)[n].click(); await later(); };
        const read = async () => { mouse("mouseenter", over(0), 0.3, 0.5);
          mouse("mousemove", over(0), 0.3, 0.5); await later(); return seen().slice(0, 3); };
        const chips = all("#switched .chip").map((chip) => chip.textContent);
        const found = { both: await read(), chips };
        await tick("switched", 0); found.second = await read();
        found.label = all(".panel-head .corrected")[0].firstChild.textContent;
        await tick("switched", 1); found.none = all(".panel-head .corrected").length;
        await tick("switched", 0); await tick("switched", 1);
        await tick("joints", 1); found.elbow = titles();
        await tick("kinds", 2); found.current = titles();
        await tick("kinds", 0); found.plain = titles();
        all(".panel-head .key.nominal")[0].click(); await later();
        found.pressed = all(".panel-head .key.nominal")[0].getAttribute("aria-pressed");
        all('[data-view*="without"]')[1].click(); await later(); found.without = await read();
        all('[data-view*="from"]')[0].click(); await later(); found.window = await span();
        return found;
        """,
    )
    both, second, without = (
        [float(text.replace("−", "-")) for text in told[name]]
        for name in ("both", "second", "without")
    )
    assert told["chips"] == ["Backlash at elbow (link side)", "Command delay"]
    assert both[2] == pytest.approx(0.99 * both[0], abs=2e-3)
    assert second[2] == pytest.approx(0.92 * second[0], abs=2e-3)
    assert told["label"] == "with 1 of 2 causes"
    assert told["none"] == 0
    assert told["elbow"] == ["elbow, rad", "elbow, error, mrad"]
    assert told["current"] == [*told["elbow"], "elbow_servo, current, A"]
    assert told["plain"] == ["elbow, rad", "elbow_servo, current, A"]
    assert told["pressed"] == "false"
    assert without[2] == pytest.approx(0.95 * without[0], abs=2e-3)
    assert 3 < told["window"][1] - told["window"][0] < 6


@pytest.mark.parametrize("dark", [False, True])
def test_it_is_light_or_dark(page: Any, dark: bool) -> None:
    """The page is as the system is; the button turns it round, the plots with it."""
    told = page(
        """
        const shade = () => getComputedStyle(document.querySelector("section")).backgroundColor;
        const system = matchMedia("(prefers-color-scheme: dark)").matches;
        const before = shade(); $("theme").click(); await later();
        const after = shade(); $("theme").click(); await later();
        return { system, before, after, again: shade() };
        """,
        dark=dark,
    )
    bright = {False: "rgb(255, 255, 255)", True: "rgb(27, 30, 36)"}
    assert told["before"] == told["again"] == bright[told["system"]]
    assert told["after"] == bright[not told["system"]]
    if dark:
        assert told["system"]


def test_it_fits_a_phone(page: Any) -> None:
    """At 390 px nothing is wider than the page, and small text stays readable."""
    told = page(
        """
        const wide = document.documentElement.scrollWidth;
        const sizes = all("main *").filter((one) => one.checkVisibility() && !one.closest("svg"))
          .filter((one) => one.textContent.trim() && !one.children.length)
          .map((one) => parseFloat(getComputedStyle(one).fontSize));
        const drawn = all(".robot text").map((one) => one.getBoundingClientRect().height);
        const cut = all(".scroll").filter((one) => one.scrollWidth > one.clientWidth + 1)
          .map((one) => one.firstElementChild.classList)
          .filter((names) => !names.contains("strip")).map(String);
        const ends = all(".panel canvas").map((one) => one.getBoundingClientRect().right);
        const widest = Math.max(...ends);
        return { wide, widest, cut, smallest: Math.min(...sizes), drawn, plots: ends.length };
        """,
        width=390,
    )
    assert told["wide"] <= 390 and told["widest"] <= 390
    assert told["smallest"] >= 10
    assert len(told["drawn"]) == 2 and all(height >= 10 for height in told["drawn"])
    assert told["cut"] == []
    assert told["plots"] == 4


def test_names_from_a_log_run_nothing(page: Any) -> None:
    """Joints, logs and actuators whose names are markup are text wherever the script puts them."""
    evil = '<img src="x" onerror="window.evil = 1"><script>window.evil = 1</script>'
    made = report()
    traces = (replace(trace(evil), log=evil),)
    signals = tuple(replace(one, log=evil, actuator=evil) for one in made.evidence.signals)
    evidence = replace(made.evidence, traces=traces, signals=signals)
    causes = tuple(replace(cause, where=evil) for cause in made.causes)
    where = (replace(made.where[0], joint=evil),)
    told = page(
        """
        all("#kinds input").forEach((box) => { if (!box.checked) box.click(); });
        all('[data-view]:not([hidden])').forEach((link) => link.click());
        await later(300);
        return { evil: window.evil ?? null, titles: titles(), images: all("img").length };
        """,
        shown=replace(made, evidence=evidence, causes=causes, where=where),
    )
    assert told["evil"] is None and told["images"] == 0
    assert told["titles"][0] == f"{evil}, rad"
    assert f"{evil}, current, A" in told["titles"]


def test_what_is_shown_can_be_saved(page: Any) -> None:
    """A table of the recording, the answer, and a picture of the plots."""
    told = page(
        """
        const saved = {};
        URL.createObjectURL = (blob) => { saved.blob = blob; return "#"; };
        HTMLAnchorElement.prototype.click = function () { saved.name = this.download; };
        const take = async (id) => {
          saved.name = null; $(id).click();
          for (let tries = 0; !saved.name && tries < 1000; tries++) await later(100);
          return [saved.name, saved.blob];
        };
        const [csv, table] = await take("csv"), [json, answer] = await take("json");
        const [png, picture] = await take("png");
        const [first, second] = (await table.text()).split("\\n");
        const { verdict } = JSON.parse(await answer.text());
        return { csv, json, png, first, second, verdict, type: picture.type, size: picture.size };
        """,
    )
    assert [told["csv"], told["json"], told["png"]] == [
        *("a.csv_episode_0.csv", "report.json", "a.csv_episode_0.png"),
    ]
    assert told["first"] == "joint,unit,time,measured,model_as_given,with_the_causes"
    assert told["second"].startswith("elbow,rad,0,")
    assert told["verdict"] == "explained"
    assert told["type"] == "image/png" and told["size"] > 5000
