"""What is unknown of windows, in as few directions as say the same."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.inference import unknowns
from sim2real.diagnosis.inference.hypotheses import Hypothesis
from sim2real.diagnosis.inference.judge import Judge
from sim2real.diagnosis.inference.replayer import Job
from tests.sim2real.diagnosis import arm

NOISE = 3e-4


def test_fewer_directions_have_the_same_covariance(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All that is left out of a window is below a tenth of the noise's variance."""
    judge = Judge(arm.data_of(arm.make_log(noise=NOISE), tmp_path))
    args = judge.replayer, judge.coarse, Hypothesis(()), np.zeros((len(judge.fold), 0))
    few, _ = unknowns.compute_unknowns(*args)
    monkeypatch.setattr(unknowns, "FAINT", -1.0)
    every, _ = unknowns.compute_unknowns(*args)
    assert 0 < few.shape[-1] <= every.shape[-1]
    used = judge.replayer.used[..., None, None]
    whole, some = (
        np.where(used, ways / judge.replayer.noise[:, None], 0.0).reshape(
            len(ways), -1, ways.shape[-1]
        )
        for ways in (every, few)
    )
    left = np.linalg.eigvalsh(whole @ whole.mT - some @ some.mT)
    assert np.abs(left).max() <= 0.1


@pytest.mark.parametrize(("share", "longer"), [(0.9, False), (1.1, True)])
def test_longer_steps_are_taken_where_they_change_little(
    share: float, longer: bool, tmp_path: Path
) -> None:
    """By up to so many noises: what they change more is no constant that can be taken off."""
    judge = Judge(arm.data_of(arm.make_log(noise=NOISE), tmp_path))
    replayer, given = judge.replayer, judge.given.own
    assert judge.coarse.data.models[0].opt.timestep > judge.data.models[0].opt.timestep
    coarse, none = replayer.coarsen(replayer.every), np.zeros((len(judge.fold), 0))
    (made,) = coarse.replay([Job(Hypothesis(()), none, replayer.every)])
    changed = ((made.error - given) / replayer.noise)[replayer.used]
    limit = share * float(np.sqrt(np.mean(changed**2)))
    replayer.settings = replace(replayer.settings, coarse_noises=limit)
    chosen = unknowns.coarsen(replayer, given, replayer.every)
    assert (chosen.data.models[0].opt.timestep > judge.data.models[0].opt.timestep) == longer


@pytest.mark.parametrize("delay", [0.0, 0.04])
def test_what_time_steps_make_is_twice_what_half_of_them_changes(
    delay: float, tmp_path: Path
) -> None:
    """An eighth of a step leaves an eighth of it; a bus that takes its time takes as long."""
    log = arm.make_log(noise=NOISE)
    judge = Judge(arm.data_of(Log(log.columns, {"command_delay": delay}), tmp_path))
    replayer = judge.replayer
    job = Job(Hypothesis(()), np.zeros((len(judge.fold), 0)), replayer.every)
    (base,) = replayer.replay([job])
    (finer,) = replayer.halved.halved.halved.replay([job])
    change, own = finer.error - base.error, unknowns.estimate_step_error(replayer, job, base.error)
    assert np.abs(change[replayer.used]).max() > 0.1 * replayer.noise.min()
    np.testing.assert_allclose(change, 7 / 8 * own, atol=0.03 * np.abs(own).max())
