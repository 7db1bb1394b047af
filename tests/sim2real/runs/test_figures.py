"""Pictures show what they should: the numbers, the frame, the units, and the interval."""

import colorsys
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from envs.params import Parameter
from sim2real.evaluation.grid import Grid
from sim2real.evaluation.grid_plots import heatmaps
from sim2real.runs import figures as plots
from sim2real.runs.errors import Sim2RealError

GRID = Grid(
    [
        {"parameter": "link_mass.torso", "values": [1.0, 2.0, 3.0]},
        {"parameter": "ground_friction", "values": [0.5, 1.5]},
    ]
)
MASS = Parameter("link_mass.torso", "link_mass", "torso", unit="kg", how="set")
FRICTION = Parameter("ground_friction", "ground_friction", how="set")


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Return the figures that are saved during the test, in order."""
    figures: list[Figure] = []
    save = Figure.savefig

    def keep(self: Figure, *args: object, **options: object) -> None:
        figures.append(self)
        save(self, *args, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(Figure, "savefig", keep)
    return figures


def curve(path: Path, level: float) -> Path:
    """Write a metrics.csv that rises by 1 a step from a level."""
    rows = [f"{x},{level + x},\n" for x in (0, 100, 200)]
    path.write_text("train/frames,train/return,eval/return\n" + "".join(rows), encoding="utf-8")
    return path


def maps(tmp_path: Path, box: dict[str, tuple[float, float]]) -> None:
    """Draw two maps and their gain."""
    values = np.arange(6.0)
    shown = {"Before": values, "After": values + 2}
    heatmaps(GRID, (MASS, FRICTION), shown, tmp_path / "map.png", box=box, gain=values - 3)


def test_the_first_axis_runs_right_and_the_second_up(tmp_path: Path, drawn: list[Figure]) -> None:
    """Cell values stand where their parameters are; maps share one scale, gains have their own."""
    maps(tmp_path, {})
    before, after, gain = (ax.collections[0] for ax in drawn[0].axes[:3])
    np.testing.assert_array_equal(np.asarray(before.get_array()), [[0, 2, 4], [1, 3, 5]])
    assert before.get_clim() == after.get_clim() == (0.0, 7.0)
    assert gain.get_clim() == (-3.0, 3.0)
    assert drawn[0].axes[0].get_xlabel() == "Torso mass (kg)"
    assert drawn[0].axes[0].get_ylabel() == "Ground friction coefficient"
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")


def test_the_training_range_is_framed(tmp_path: Path, drawn: list[Figure]) -> None:
    """The frame has the range's corners, cut at the picture's edge."""
    maps(tmp_path, {"link_mass.torso": (1.2, 9.0), "ground_friction": (0.5, 1.0)})
    for ax in drawn[0].axes[:3]:
        light, dark = (patch for patch in ax.patches if isinstance(patch, Rectangle))
        for frame in (light, dark):
            np.testing.assert_allclose(frame.get_bbox().extents, [1.2, 0.5, 3.5, 1.0])
        assert light.get_edgecolor()[:3] == (1, 1, 1) and dark.get_edgecolor()[:3] == (0, 0, 0)


def test_a_single_training_robot_is_a_cross(tmp_path: Path, drawn: list[Figure]) -> None:
    """A range of no width in either direction cannot be framed."""
    maps(tmp_path, {"link_mass.torso": (2.0, 2.0), "ground_friction": (1.0, 1.0)})
    ax = drawn[0].axes[0]
    assert not ax.patches
    assert [np.asarray(line.get_xydata()).tolist() for line in ax.lines] == [[[2.0, 1.0]]] * 2


def test_a_learning_curve_is_the_mean_of_its_seeds(tmp_path: Path, drawn: list[Figure]) -> None:
    """Two seeds 10 apart give the line between them, shaded from one to the other."""
    files = [curve(tmp_path / "a.csv", 0.0), curve(tmp_path / "b.csv", 10.0)]
    plots.learning_curve({"es": files, "single": files[:1]}, tmp_path / "curve.png")
    ax = drawn[0].axes[0]
    x, y = ax.lines[0].get_data()
    np.testing.assert_allclose(np.asarray(y) - np.asarray(x), 5.0)
    assert len(ax.collections) == 1
    band = ax.collections[0].get_paths()[0].get_extents()
    assert (band.y0, band.y1) == (0.0, 210.0)
    assert ax.get_xlabel() == "Environment steps"
    legend = ax.get_legend()
    assert legend is not None
    assert [t.get_text() for t in legend.get_texts()] == ["es (2 seeds)", "single"]


def test_a_curve_without_its_column_is_refused(tmp_path: Path) -> None:
    """The columns that there are are listed; a column without a number is no curve."""
    path = curve(tmp_path / "a.csv", 0.0)
    with pytest.raises(Sim2RealError, match="no column 'train/loss'; it has: train/frames"):
        plots.learning_curve({"": [path]}, tmp_path / "curve.png", y="train/loss")
    with pytest.raises(Sim2RealError, match="no row with both"):
        plots.learning_curve({"": [path]}, tmp_path / "curve.png", y="eval/return")
    assert not (tmp_path / "curve.png").exists()


def test_labels_say_what_a_value_does_to_the_model() -> None:
    """Added and factor are said; a set value has its unit alone."""
    assert plots.label(MASS) == "Torso mass (kg)"
    added = Parameter("link_mass.torso", "link_mass", "torso", unit="kg", how="add")
    assert plots.label(added) == "Added torso mass (kg)"
    factor = Parameter("motor_strength", "motor_strength", neutral=1.0, how="scale")
    assert plots.label(factor) == "Motor strength (factor)"
    assert plots.label(FRICTION) == "Ground friction coefficient"
    assert plots.label(Parameter("goal.x", "goal", unit="m", how="set")) == "Goal x (m)"


def test_a_picture_that_fails_leaves_nothing_behind(tmp_path: Path) -> None:
    """No half file and no temporary one."""
    with pytest.raises(RuntimeError), plots.figure(tmp_path / "a.png", 1, 1, (1, 1)):
        raise RuntimeError
    assert not any(tmp_path.iterdir())


def test_a_divergence_is_in_nats_and_decades(tmp_path: Path, drawn: list[Figure]) -> None:
    """One update that diverges must not hide the others."""
    file = tmp_path / "m.csv"
    file.write_text("train/frames,train/kl\n0,0.001\n100,2.0\n", encoding="utf-8")
    plots.learning_curve({"ppo": [file]}, tmp_path / "kl.png", y="train/kl")
    ax = drawn[0].axes[0]
    assert (ax.get_yscale(), ax.get_ylabel()) == ("log", "KL divergence (nat)")


def test_before_and_after_have_one_colour_everywhere() -> None:
    """The hues of the report's page are those of the pictures, darker where they are text."""
    page = Path(__file__).parents[3] / "sim2real/diagnosis/report/page/colours.css"
    style = page.read_text(encoding="utf-8")
    for name, colour in (("before", plots.BEFORE), ("after", plots.AFTER)):
        shades = re.findall(rf"--{name}: (#[0-9a-f]{{6}})", style)
        assert len(shades) == 3
        for shade in shades:
            assert abs(hue(shade) - hue(colour)) < 0.05


def hue(colour: str) -> float:
    """Return where a colour lies on the colour circle, 0 to 1."""
    return colorsys.rgb_to_hsv(*(int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)))[0]
