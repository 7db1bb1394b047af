"""The robot on the page moves as its model does, and is seen at the cursor's moment."""

import html
import json
import subprocess
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from envs.models import load_spec
from hardware.assets import ASSETS
from sim2real.diagnosis.report import motion
from sim2real.diagnosis.report.html import PAGE
from tests.sim2real.diagnosis.report.test_browser import drive, sample

pytestmark = pytest.mark.render
MIXED = """
<mujoco><worldbody><body name="base" pos="0 0 1"><freejoint name="root"/>
<geom type="box" size=".1 .06 .04"/>
<body name="cart" pos=".1 0 0" quat="0.9 0.1 0.3 0.2"><joint name="rail" type="slide" axis="1 2 0"/>
<geom type="cylinder" size=".02 .1"/>
<body name="arm" pos="0 .1 0"><joint name="yaw" axis="0 0 1" pos="0 0.02 0"/>
<joint name="roll" axis="1 1 0" pos="0.03 0 0"/>
<geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02"/>
<body name="hand" pos="0 0 -.2"><joint name="wrist" type="ball"/><geom type="sphere" size=".03"/>
</body></body></body></body></worldbody></mujoco>
"""


def models() -> dict[str, mujoco.MjModel]:
    """Return robots with all kinds of joints."""
    found = {name: load_spec(ASSETS / f"{name}.xml").compile() for name in ("arm6", "quad8")}
    return {**found, "mixed": mujoco.MjModel.from_xml_string(MIXED)}


def browsed(browser: str, folder: Path, asked: list[dict]) -> list[list[list[float]]]:
    """Return the points of all shapes, one after the other, that the page's script computes."""
    script = (PAGE / "motion.js").read_text(encoding="utf-8")
    page = folder / "page.html"
    page.write_text(
        f"""<pre id="told"></pre><script>let data; {script}
        const told = {json.dumps(asked)}.map((one) => {{
          data = one; return shapesAt(one.values).flatMap((shape) => shape.points); }});
        document.getElementById("told").textContent = JSON.stringify(told);</script>"""
    )
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom"]
    command += [f"--user-data-dir={folder / 'profile'}", page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200, check=True)
    told = done.stdout.rsplit('<pre id="told">', 1)[1].split("</pre>", 1)[0]
    return json.loads(html.unescape(told))


def test_the_script_moves_bodies_as_mujoco_does(browser: str, tmp_path: Path) -> None:
    """Points of all shapes are within 0.1 mm, for hinges and slides; a free base stays at home."""
    rng, asked, wanted = np.random.default_rng(0), [], []
    for model in models().values():
        data = motion.robot_drawing.at_home(model)
        moved = [j for j in range(model.njnt) if int(model.jnt_type[j]) in motion.MOVED]
        for joint in moved:
            data.qpos[model.jnt_qposadr[joint]] += rng.uniform(-1, 1)
        mujoco.mj_kinematics(model, data)
        values = {model.joint(j).name: float(data.qpos[model.jnt_qposadr[j]]) for j in moved}
        asked.append({"skeleton": motion.skeleton(model), "values": values})
        points = []
        for geom, _, own, _ in motion.robot_drawing.outlines(model):
            body = int(model.geom_bodyid[geom])
            points.append(data.xpos[body] + own @ data.xmat[body].reshape(3, 3).T)
        wanted.append(np.concatenate(points))
    for found, right in zip(browsed(browser, tmp_path, asked), wanted, strict=True):
        np.testing.assert_allclose(np.array(found), right, atol=1e-4)


def test_the_robot_follows_the_cursor(browser: str, tmp_path: Path) -> None:
    """Measured and both simulations at the cursor's moment; a switch and a button change them."""
    told = drive(
        browser,
        tmp_path,
        """
        const robot = $("robot"), shot = () => robot.toDataURL(), found = {};
        const at = async (x) => { mouse("mouseenter", over(0), x, 0.5);
          mouse("mousemove", over(0), x, 0.5); await later(); };
        await at(0.25); const first = shot(); found.clock = $("clock").textContent;
        await at(0.6); const second = shot(); await at(0.25);
        found.moved = first !== second; found.repeated = first === shot();
        found.shown = robot.dataset.shown;
        $("grow").value = "20"; $("grow").dispatchEvent(new Event("change"));
        found.grown = shot() !== first;
        all("#switched input").forEach((box) => box.click()); await later();
        found.alone = robot.dataset.shown;
        mouse("dblclick", over(0), 0.5, 0.5); await later(); await at(0.5);
        $("play").click(); const before = $("clock").textContent;
        found.playing = $("play").textContent;
        await later(400);
        found.ran = parseFloat($("clock").textContent) - parseFloat(before);
        $("play").click(); found.paused = $("play").textContent;
        return found;
        """,
    )
    assert float(told["clock"].removesuffix(" s")) == pytest.approx(3.0, abs=0.05)
    assert told["moved"] and told["repeated"] and told["grown"]
    assert told["ran"] == pytest.approx(0.4, abs=0.05)  # s, as long as the wait
    assert told["shown"] == "nominal corrected" and told["alone"] == "nominal"
    assert (told["playing"], told["paused"]) == ("Pause", "Play")


def test_without_a_model_there_is_no_robot(browser: str, tmp_path: Path) -> None:
    """The recordings are there all the same."""
    made = sample()
    inputs = {**made.evidence.inputs, "models": ["gone.xml"]}
    shown = replace(made, evidence=replace(made.evidence, inputs=inputs))
    script = "return { hidden: $('motion').hidden, plots: all('.panel').length };"
    assert drive(browser, tmp_path, script, shown=shown) == {"hidden": True, "plots": 4}
