"""Offsets and drifts that were put into a log are found, and a log on one clock is left alone."""

import numpy as np
import pytest
from scipy.signal import lfilter

from hardware.log import Log
from sim2real.diagnosis.preflight.clocks import check_clocks, speed_shift, stamp_drift

RATE, SECONDS = 100.0, 60.0  # Hz, s
COUNT = 2 * np.pi / 4096  # rad, of an encoder
SPEED = 0.024  # rad/s, of a Dynamixel's speed register


def motion(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return position and speed of a rich motion."""
    tones = [(0.3, 0.6, 0.0), (0.9, 0.3, 1.0), (2.1, 0.1, 2.0)]  # Hz, rad, rad
    angle = sum(a * np.sin(2 * np.pi * f * time + p) for f, a, p in tones)
    speed = sum(2 * np.pi * f * a * np.cos(2 * np.pi * f * time + p) for f, a, p in tones)
    return np.asarray(angle), np.asarray(speed)


def log(late: float = 0.0, ppm: float = 0.0, filtered: float = 0.0, seed: int = 0) -> Log:
    """Return a log whose speed is late [s] or filtered [s], and whose stamps drift [ppm]."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, SECONDS, 1 / RATE)
    time += rng.normal(0, 3e-4, len(time)).clip(-1e-3, 1e-3)
    time -= time[0]
    read = time - 2e-3 + rng.normal(0, 3e-4, len(time))
    angle, _ = motion(read)
    _, speed = motion(read - late)
    if filtered:
        share = 1 - np.exp(-1 / RATE / filtered)
        speed = np.asarray(lfilter([share], [1, share - 1], speed))
    columns = {
        "episode": np.zeros(len(time)),
        "time": time,
        "ctrl.hinge": angle,
        "qpos.hinge": COUNT * np.round(angle / COUNT),
        "qvel.hinge": SPEED * np.round(speed / SPEED),
        "stamp.hinge": read * (1 + 1e-6 * ppm),
    }
    return Log(columns)


@pytest.mark.parametrize("late", [-0.05, -0.01, 0.03, 0.05])
def test_an_offset_between_channels_is_found_to_a_millisecond(late: float) -> None:
    """Counts and a coarse speed register do not hide it."""
    shift = speed_shift([log(late)], "hinge")
    assert shift is not None
    assert shift.seconds == pytest.approx(late, abs=1e-3)
    (finding,) = check_clocks([log(late)])
    assert (finding.check, finding.where) == ("clock", "hinge")
    assert ("later" if late > 0 else "earlier") in finding.finding


@pytest.mark.parametrize("ppm", [-200.0, 100.0, 200.0])
def test_a_drift_is_found_to_twenty_ppm(ppm: float) -> None:
    """A minute of stamps tells the two clocks' rates apart."""
    drift = stamp_drift(log(ppm=ppm), "hinge")
    assert drift is not None
    assert drift[0] == pytest.approx(ppm, abs=20)
    (finding,) = check_clocks([log(ppm=ppm)])
    assert finding.check == "drift" and ("fast" if ppm > 0 else "slow") in finding.finding


@pytest.mark.parametrize("seed", range(5))
def test_one_clock_is_left_alone(seed: int) -> None:
    """Jitter, counts and a constant latency are no finding."""
    assert check_clocks([log(seed=seed)]) == []


def test_a_filtered_speed_is_no_late_one() -> None:
    """A servo's speed filter delays slow motion as much; it is not called a clock's offset."""
    assert check_clocks([log(filtered=0.03)]) == []


def test_a_nominal_clock_is_said() -> None:
    """Times that were computed from a frame's number cannot tell small delays."""
    made = log()
    (finding,) = check_clocks([Log(made.columns, {"clock": "nominal"})])
    assert "computed, not measured" in finding.finding


def test_logs_that_say_nothing() -> None:
    """A joint at rest, a handful of rows, or no speed: no finding and no error."""
    rest = log()
    still = {c: 0 * v if c.startswith("q") else v for c, v in rest.columns.items()}
    short = {c: v[:10] for c, v in rest.columns.items()}
    bare = {c: v for c, v in rest.columns.items() if not c.startswith(("qvel", "stamp"))}
    assert check_clocks([Log(still), Log(short), Log(bare)]) == []
