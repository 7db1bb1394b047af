"""What hypotheses make of the windows: errors on the rows that the likelihood looks at.

    replayer = Replayer(data, fixed)
    (one,) = replayer.replay([Job(hypothesis, values, windows)])
    one.error                               # (n, N, M) simulated minus measured

The same windows are replayed under every hypothesis: where the log is changed they are cut anew
from the mended log, with the same readings. Errors are those of readings as logged, whose noise is
known: else shrinking the readings would make any model right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from envs.plant import Fixed
from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.noise_floor import reading_noise
from sim2real.diagnosis.data.simulate import BATCH, Simulator, Work
from sim2real.diagnosis.data.starts import faster, further, slope_errors, speeds_at, start_errors
from sim2real.diagnosis.data.windows import Window, cut_one
from sim2real.diagnosis.inference.batches import Rows, simulate_each
from sim2real.diagnosis.inference.hypotheses import Hypothesis
from sim2real.diagnosis.inference.usual import list_usual
from sim2real.diagnosis.settings import TINY

MENDED = 32  # mended logs that are kept
SHORTER = 2  # times shorter steps of what needs them, see `Hypothesis`

Key = tuple[tuple[str, ...], bytes]


class Job(NamedTuple):
    """Windows to be replayed under values of a hypothesis."""

    hypothesis: Hypothesis
    values: np.ndarray  # (n, P)
    windows: np.ndarray  # (n,)


class Replay(NamedTuple):
    """What a job came to, in the units of the data's errors."""

    error: np.ndarray  # (n, N, M) simulated minus measured
    slope: np.ndarray  # (n, N, M) its change with the time of reading [1/s]


class _Mended(NamedTuple):
    """Logs without some mistakes, and their windows."""

    key: Key
    logs: tuple[Log, ...]
    windows: tuple[Window, ...]
    measured: np.ndarray  # (W, T, M)
    scale: np.ndarray  # (M,) |d reading as logged / d mended reading|


class _Ask(NamedTuple):
    """Rows of a job whose log is mended alike."""

    job: int
    windows: np.ndarray  # (n,)
    values: np.ndarray  # (n, P) of the effects
    log: _Mended | None  # None: as it is
    rows: np.ndarray | slice = slice(None)  # (n,) of the job

    @property
    def scale(self) -> np.ndarray:
        """|d reading as logged / d mended reading| of each joint, (M,) or ()."""
        return np.ones(()) if self.log is None else self.log.scale


class Replayer:
    """Replays windows of logs under hypotheses; `fixed` effects are part of the model."""

    def __init__(self, data: Data, fixed: Sequence[Fixed] = (), work: Work | None = None) -> None:
        self.data, self.fixed = replace(data, starts=None), tuple(fixed)
        self.work = Work() if work is None else work
        self.settings = data.settings.inference
        self.rows, self.used = _spread(data.mask, self.settings.rows_max)  # (W, N) each
        own = zip(self.rows, data.windows, strict=True)
        self.times = np.stack([w.sample[np.minimum(r, len(w.sample) - 1), 0] for r, w in own])
        self.every = np.arange(len(data.windows))
        spread = np.array([joint.spread for joint in data.joints])
        noise = [reading_noise(data.logs, f"qpos.{j.name}", data.settings) for j in data.joints]
        known = [joint.floor for joint in data.joints]
        least = np.maximum(self.settings.negligible * spread, np.maximum(known, TINY))
        self.noise = np.maximum(noise, least) / data.scale  # (M,)
        self.count = np.array([joint.count for joint in data.joints]) / data.scale
        self.finer: Replayer | None = None  # for what needs shorter steps
        self.offset = np.zeros((*self.rows.shape, len(self.noise)))  # that longer steps leave out
        self.estimated = np.zeros((*self.offset.shape, 0))  # (W, N, M, D) of starts
        if data.starts is not None:
            self.estimated = self._look(data.starts, self.every)
        self.plain = Simulator(self.data, self.fixed, work=self.work)
        self._mended: dict[Key, _Mended] = {}

    def part(self, windows: np.ndarray, data: Data | None = None) -> Replayer:
        """Return a replayer of some windows, (n,), at the same rows and with the same noise.

        `data` are all windows with other models of the same robot; None: as they are here.
        """
        own = (self.data if data is None else data).only(windows)
        other = Replayer(own, self.fixed, self.work)
        other.rows, other.used = self.rows[windows], self.used[windows]
        other.times, other.noise, other.count = self.times[windows], self.noise, self.count
        other.offset = self.offset[windows]
        return other

    @property
    def compared(self) -> int:
        """How many rows are compared, of each joint."""
        return int(self.used.sum())

    @property
    def _together(self) -> int:
        """How many windows are replayed in one call, by the memory of their errors."""
        size = self.data.mask.shape[1] * len(self.noise) * self.noise.itemsize
        return max(int(BATCH / size), 1)

    def coarsen(self, windows: np.ndarray) -> Replayer:
        """Return a replayer of some windows, (n,), in longer time steps.

        What needs shorter ones takes them, see `Hypothesis`.
        """
        most = self.settings.coarse_s
        other = self.part(windows, self.data.stepping(most))
        other.finer = self.part(windows, self.data.stepping(most / SHORTER))
        return other

    @cached_property
    def halved(self) -> Replayer:
        """The same windows in time steps half as long."""
        return self.part(self.every, self.data.halve_steps())

    def anchor(self, hypothesis: Hypothesis, values: np.ndarray, errors: np.ndarray) -> None:
        """Correct all errors by what those of a hypothesis under values (W, P) lack, (W, N, M)."""
        (made,) = self._replay([Job(hypothesis, values, self.every)])
        self.offset = self.offset + errors - made.error
        if self.finer is not None:
            self.finer.anchor(hypothesis, values, errors)

    def replay(self, jobs: Sequence[Job]) -> list[Replay]:
        """Return what each job comes to; jobs share batches, those with changed logs theirs."""
        if self.finer is None:
            return self._replay(jobs)
        finer = [job.hypothesis.needs_short_steps for job in jobs]
        made = iter(self.finer.replay([job for job, own in zip(jobs, finer, strict=True) if own]))
        rest = iter(self._replay([job for job, own in zip(jobs, finer, strict=True) if not own]))
        return [next(made if own else rest) for own in finer]

    def _replay(self, jobs: Sequence[Job]) -> list[Replay]:
        shape = self.used.shape[1], len(self.noise)
        found = [Replay(*np.zeros((2, len(job.windows), *shape))) for job in jobs]
        changed = [bool(job.hypothesis.changes) for job in jobs]
        for mended in (False, True):
            own = [number for number, other in enumerate(changed) if other == mended]
            ends = np.cumsum([len(jobs[number].windows) for number in own]) // self._together
            for part in np.unique(ends):
                some = [number for number, end in zip(own, ends, strict=True) if end == part]
                self._fill(found, jobs, [ask for n in some for ask in self._asks(n, jobs[n])])
        return found

    def _fill(self, found: list[Replay], jobs: Sequence[Job], asks: Sequence[_Ask]) -> None:
        """Replay what is asked for in one call, into the results of its jobs."""
        logs = list({ask.log.key: ask.log for ask in asks if ask.log is not None}.values())
        simulator = _stacked(self, logs) if logs else self.plain
        place = {log.key: number * len(self.every) for number, log in enumerate(logs)}
        rows = [
            Rows(
                jobs[ask.job].hypothesis.effects,
                ask.windows + (0 if ask.log is None else place[ask.log.key]),
                ask.values,
            )
            for ask in asks
        ]
        for ask, made in zip(asks, simulate_each(simulator, rows), strict=True):
            own, result = ask.rows, found[ask.job]
            error = self._look(made.error, ask.windows) * ask.scale
            result.error[own] = error + self.offset[ask.windows]
            result.slope[own] = self._look(made.slope, ask.windows) * ask.scale

    def _asks(self, number: int, job: Job) -> list[_Ask]:
        """Return the rows of a job by how their log is mended."""
        if not job.hypothesis.changes:
            return [_Ask(number, job.windows, job.values, None)]
        count = sum(len(member.neutral) for member in job.hypothesis.effects)
        effects, changes = job.values[:, :count], job.values[:, count:]
        _, first, group = np.unique(changes, axis=0, return_index=True, return_inverse=True)
        asks = []
        for index, place in enumerate(first):
            own = np.flatnonzero(group.ravel() == index)
            log = self._mend(job.hypothesis, changes[place])
            asks.append(_Ask(number, job.windows[own], effects[own], log, own))
        return asks

    def follow(self, hypothesis: Hypothesis, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the errors of all rows under values (W, P), and when each window is lost.

        Returns:
            Errors, (W, T, M), 0 where none compares; s from a window's start, (W,), or inf.
        """
        found = np.zeros((*self.data.mask.shape, len(self.noise)))
        lost = np.full(len(self.every), np.inf)
        for ask in self._asks(0, Job(hypothesis, values, self.every)):
            simulator = _stacked(self, [ask.log]) if ask.log else self.plain
            (made,) = simulate_each(simulator, [Rows(hypothesis.effects, ask.windows, ask.values)])
            found[ask.rows], lost[ask.rows] = made.error * ask.scale, made.lost
        return found, lost

    def starts(self, hypothesis: Hypothesis, values: np.ndarray) -> np.ndarray:
        """Return what one standard deviation of each start changes, (W, N, M, 2 M + K).

        Positions are off by the noise of a reading, speeds by that of what they were taken from,
        and each of K memories of effects by what logs do not tell of it; the model is a hypothesis
        under values (W, P).
        """
        if self.finer is not None and hypothesis.needs_short_steps:
            return self.finer.starts(hypothesis, values)
        (base,) = self._replay([Job(hypothesis, values, self.every)])
        model, sets = self.data.models[0], 2 * len(self.noise)
        names = [name for one in hypothesis.effects for name in one.effect.memory(model)]
        ways = np.empty((*base.error.shape, sets + len(names)))
        for ask in self._asks(0, Job(hypothesis, values, self.every)):
            simulator, own = self._moved(ask), np.arange(len(ask.windows))
            places = [own + min(way, sets) * len(own) for way in range(ways.shape[-1])]
            rows = [
                Rows(hypothesis.effects, place, ask.values, off)
                for place, off in zip(places, [*[""] * sets, *names], strict=True)
            ]
            for way, made in enumerate(simulate_each(simulator, rows)):
                error = self._look(made.error, ask.windows) * ask.scale
                ways[ask.rows, ..., way] = error + self.offset[ask.windows] - base.error[ask.rows]
        return ways

    def usual(self, hypothesis: Hypothesis, values: np.ndarray) -> np.ndarray:
        """Return what one standard deviation of each nominal parameter changes, (W, N, M, U)."""
        jobs = [Job(hypothesis, values, self.every)]
        for factor in list_usual(self.data, hypothesis.effects):
            more = np.full((len(values), 1), 1 + self.settings.usual)
            changed = Hypothesis((*hypothesis.effects, factor, *hypothesis.changes))
            place = sum(len(member.neutral) for member in hypothesis.effects)
            jobs.append(Job(changed, np.insert(values, [place], more, axis=1), self.every))
        base, *others = self.replay(jobs)
        ways = [other.error - base.error for other in others]
        return np.stack(ways, axis=-1) if ways else np.zeros((*base.error.shape, 0))

    def ballistic(self) -> np.ndarray:
        """Return what an error of each start changes where no force is known, (W, N, M, 2 M)."""
        count = len(self.noise)
        ways = np.zeros((*self.used.shape, count, 2 * count))
        for joint in range(count):
            ways[..., joint, joint] = self.noise[joint]
            ways[..., joint, count + joint] = self.speed_noise[:, joint, None] * self.times
        return ways

    @cached_property
    def speed_noise(self) -> np.ndarray:
        """The error of each window's speeds at its start, in the units of errors a second, (W, M).

        At least what the noise of a reading makes, or that of a logged speed.
        """
        data, logged = self.data, [f"qvel.{joint.name}" for joint in self.data.joints]
        known = [all(column in log.columns for log in data.logs) for column in logged]
        own = np.stack([start_errors(data, window) for window in data.windows]) / data.scale
        slopes = slope_errors(data, data.windows[0], self.noise * data.scale)
        for joint, column in enumerate(logged):
            noise = reading_noise(data.logs, column, data.settings)
            least = (noise if known[joint] else slopes[joint]) / data.scale[joint]
            own[:, joint] = np.maximum(own[:, joint], max(least, TINY))
        return own

    def holding(self) -> np.ndarray:
        """Return the errors of "each joint stays", (W, N, M)."""
        return self._path(0.0)

    def coasting(self) -> np.ndarray:
        """Return the errors of "each joint keeps its measured speed", (W, N, M)."""
        return self._path(1.0)

    def _path(self, speed: float) -> np.ndarray:
        """Return the errors of joints that move on at so much of their speed at the start."""
        data, found = self.data, np.zeros((*self.used.shape, len(self.noise)))
        measured = data.measured[self.every[:, None], self.rows]
        for number, window in enumerate(data.windows):
            model, own = data.models[window.model], window.recording
            places = [joint.qpos for joint in data.joints]
            moved = self.times[number][:, None] * speeds_at(data, model, own.qvel)
            path = own.qpos[places] + speed * moved
            found[number] = (path - measured[number]) / data.scale
        return np.where(self.used[..., None], found, 0.0)

    def _moved(self, ask: _Ask) -> Simulator:
        """Return a simulator of the windows asked for, with each start off: one set a start.

        The last set is as it is.
        """
        data = (_stacked(self, [ask.log]) if ask.log else self.plain).data
        some, moved = data.only(ask.windows), []
        noise = np.broadcast_to(self.noise, self.speed_noise.shape)
        for shift, sizes in ((further, noise), (faster, self.speed_noise)):
            sizes = (sizes * self.data.scale / ask.scale)[ask.windows]
            for joint in range(len(self.noise)):
                pairs = zip(some.windows, sizes[:, joint], strict=True)
                moved += [shift(data, window, joint, float(size)) for window, size in pairs]
        moved, sets = [*moved, *some.windows], 2 * len(self.noise) + 1
        mask, measured = np.tile(some.mask, (sets, 1)), np.tile(some.measured, (sets, 1, 1))
        return self.plain.of(replace(some, windows=tuple(moved), mask=mask, measured=measured))

    def _mend(self, hypothesis: Hypothesis, values: np.ndarray) -> _Mended:
        """Return the windows of mended logs."""
        key = (tuple(change.label for change in hypothesis.changes), values.tobytes())
        if key in self._mended:
            return self._mended[key]
        data, logs = self.data, list(self.data.logs)
        scale, start, late = np.ones(len(data.joints)), 0, 0
        for change in hypothesis.changes:
            own = values[start : (start := start + len(change.neutral))]
            logs = [change.mended(log, own) for log in logs]
            scaled = [joint.name in change.read for joint in data.joints]
            scale = np.where(scaled, scale * abs(change.first(own)), scale)
            late += round(change.late(own))
        windows = [self._cut(logs, window, late) for window in data.windows]
        measured = data.measured.copy()  # (W, T, M), padded as all windows of the log were
        for row, window in zip(measured, windows, strict=True):
            row[: len(window.measured)] = window.measured
        if len(self._mended) >= MENDED:
            self._mended.pop(next(iter(self._mended)))
        self._mended[key] = _Mended(key, tuple(logs), tuple(windows), measured, scale)
        return self._mended[key]

    def _cut(self, logs: Sequence[Log], window: Window, late: int) -> Window:
        """Return the window of mended logs with the same readings, if its episode has the rows."""
        log, data = logs[window.log], self.data
        own = np.flatnonzero(log.episode == log.episode[window.first])
        late = int(np.clip(late, window.last - 1 - own[-1], window.start - own[0]))
        rows = (window.start - late, window.first - late, window.last - late)
        args = data.models[window.model], data.joints, rows, data.settings.windows
        return cut_one(log, window.log, window.model, *args)._replace(usable=window.usable)

    def _look(self, values: np.ndarray, windows: np.ndarray) -> np.ndarray:
        """Return the compared rows (n, N, M) of values (n, T, M) of windows (n,)."""
        return values[np.arange(len(windows))[:, None], self.rows[windows]]


def _stacked(replayer: Replayer, logs: Sequence[_Mended]) -> Simulator:
    """Return a simulator of the windows of several mended logs, one after the other."""
    data, count = replayer.data, len(replayer.data.logs)
    windows = [
        window._replace(log=window.log + number * count)
        for number, log in enumerate(logs)
        for window in log.windows
    ]
    mended = replace(
        data,
        logs=tuple(one for log in logs for one in log.logs),
        windows=tuple(windows),
        mask=np.tile(data.mask, (len(logs), 1)),
        measured=np.concatenate([log.measured for log in logs]),
    )
    return replayer.plain.of(mended)


def _spread(mask: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Return rows of each window, evenly over those compared, and which there are, (W, N) each."""
    count = min(most, int(mask.sum(axis=1).max()))
    rows, used = np.zeros((len(mask), count), int), np.zeros((len(mask), count), bool)
    for number, own in enumerate(mask):
        there = np.flatnonzero(own)
        some = there[
            np.unique(np.linspace(0, len(there) - 1, min(count, len(there))).round().astype(int))
        ]
        rows[number, : len(some)], used[number, : len(some)] = some, True
    return rows, used
