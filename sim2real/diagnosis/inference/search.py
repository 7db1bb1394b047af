"""The search: what is fitted, of all that may explain the gap.

    search = Search(judge, local, common)
    search.refine(best, starts, tried)          # what promises most in addition to the best
    search.swap(best, tried)                    # what does about the same as its members

Every change is looked at in some of the windows and in longer time steps; those that promise most
are fitted there, and the better half of them to all windows. The judge says what wins.
"""

from __future__ import annotations

import operator
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from sim2real.diagnosis.inference.candidates import Candidate
from sim2real.diagnosis.inference.criteria import Criteria
from sim2real.diagnosis.inference.fit import Fit, Start
from sim2real.diagnosis.inference.glance import HALVES, Glance, Quick
from sim2real.diagnosis.inference.hypotheses import Hypothesis, Member, get_kind
from sim2real.diagnosis.inference.moves import (
    list_elaborated,
    list_simpler,
    list_untied,
    pick_distinct,
    pick_unlike,
    rank_fits,
    restart,
    without,
)
from sim2real.diagnosis.inference.replayer import Replayer
from sim2real.diagnosis.inference.screen import (
    Line,
    list_closing,
    list_promising,
    pick_alike,
    pick_closest,
    pick_pairs,
    pick_starts,
    trace_lines,
)


class Search:
    """Fits what may explain the gap; the judge says what wins.

    `coarse` replays all windows in longer time steps; for `local` and `common` see `Likelihood`.
    """

    def __init__(
        self, judge: Criteria, coarse: Replayer, local: np.ndarray, common: np.ndarray
    ) -> None:
        self._judge, self.settings = judge, judge.settings
        self.quick = Quick(judge.fitter, judge.given, coarse)
        left = judge.left_in_windows(judge.given)
        self.glance = Glance(judge.fitter, judge.given, left, local, common)
        self.lines: list[Line] = []  # through all probes, beside the first

    def renew(self, local: np.ndarray, common: np.ndarray) -> None:
        """Judge by the judge's present unknowns from now on; see `Search`."""
        self.quick.likelihood = self._judge.fitter.likelihood
        self.glance.renew(self._judge.fitter, local, common)

    def anchor(self, best: Fit, tried: dict[str, Fit]) -> Fit:
        """Return the best in the model's own steps; longer ones then change nothing of it."""
        if best.hypothesis.members:
            (best,) = self._judge.fitter.fit([restart(best)], rounds=0)
            tried[best.label] = best
            self.quick.anchor(best)
            self.glance.anchor(best)
        return best

    def list_closing(self, starts: Sequence[Start]) -> list[str]:
        """Return the labels of changes that may close most of the gap by themselves."""
        (base,) = self.glance.fit([restart(self._judge.given)], rounds=0)
        return list_closing(self.glance, base, trace_lines(self.glance, base, starts))

    def refine(self, best: Fit, starts: Sequence[Start], tried: dict[str, Fit]) -> None:
        """Fit what promises most with the best into what was tried; pairs if no change does.

        A promise leaves the discrepancy as large as it is, so that a fit may gain more: promises
        tell which changes are fitted, not whether any is worth it.

        What acts beyond a threshold only, a stop or a play, has no slope to be screened by: where
        there is a gap and no straight line promises what it has to win, every change is fitted at a
        glance. Promises are alike where the discrepancy absorbs the errors: some mistakes of the
        log, and what comes nearest to it, are always fitted.
        """
        judge, first, most = self._judge, not self.lines, self.settings.refits
        gap = not judge.explains(best)
        (base,) = self.glance.fit([restart(best)], rounds=0)
        if not first:
            labels = list_promising(self.glance, base, self.lines, self.settings.promising)
            starts = [start for start in starts if start.hypothesis.label in labels]
        lines = trace_lines(self.glance, base, starts)
        if first:
            self.lines = lines
        gains = [line.gain / self.glance.replayer.compared for line in lines]
        prices = [judge.price(Hypothesis((line.member,))) for line in lines]
        flat = gap and all(map(operator.lt, gains, prices))
        chosen = pick_starts(base, lines, len(lines) if flat and first else most)
        mistakes = [line for line in lines if get_kind(line.member) == "log"]
        further = pick_starts(base, mistakes, self.settings.alike)
        further += pick_closest(self.glance, base, lines, self.settings.alike)
        named = {start.hypothesis.label: start for start in (*further, *chosen)}
        self._fit(list(named.values()), tried)
        pairs = len(best.hypothesis.members) + 1 < self.settings.members_max
        if first and gap and pairs and not judge.is_enough(judge.choose(tried)):
            self._fit(pick_pairs(self.glance, base, lines, most), tried)

    def untie(self, best: Fit, options: Sequence[Candidate], tried: dict[str, Fit]) -> None:
        """Fit a value for each joint where the best has one for all into what was tried, once."""
        self._fit_new(list_untied(best, options), tried)

    def elaborate(self, best: Fit, tried: dict[str, Fit]) -> None:
        """Fit the best with the further values of its effects into what was tried, once."""
        self._fit_new(list_elaborated(best), tried)

    def _fit_new(self, starts: Sequence[Start], tried: dict[str, Fit]) -> None:
        self._fit([start for start in starts if start.hypothesis.label not in tried], tried)

    def look_closer(self, before: Fit, tried: dict[str, Fit]) -> None:
        """Fit the best of what is longer in the model's own steps into what was tried, if none won.

        Longer steps change contacts, which may cost what an explanation gains. The best that mends
        the log was judged in its own ones. `before` was the best of what is shorter.
        """
        most = len(before.hypothesis.members)
        if len(self._judge.choose(tried).hypothesis.members) > most:
            return
        longer = [fit for fit in tried.values() if len(fit.hypothesis.members) > most]
        plain = rank_fits([fit for fit in longer if not fit.hypothesis.mended])
        own = self._judge.fitter.fit(map(restart, plain[: self.settings.rivals]))
        tried.update({fit.label: fit for fit in own})

    def swap(self, best: Fit, tried: dict[str, Fit]) -> None:
        """Fit what does about the same as each member in its place."""
        best = self.anchor(best, tried)
        plain = [line.member for line in self.lines]
        more = (one.elaborated() for one in plain if isinstance(one, Candidate))
        others = [*plain, *(one for one in more if one is not None)]
        simpler = self._exchange(best, self.lines, others, tried)
        keep_better(self.quick.fit([restart(best), *simpler]), tried)

    def imitate(self, best: Fit, excluded: Sequence[Start]) -> list[Fit]:
        """Return fits of excluded changes in the place of each member of the best, and of all.

        The steps are anchored to the best.
        """
        found: dict[str, Fit] = {}
        (given,) = self.glance.fit([restart(self._judge.given)], rounds=0)
        lines = trace_lines(self.glance, given, excluded)
        members = [start.hypothesis.members[0] for start in excluded]
        keep_better(self.quick.fit(self._exchange(best, lines, members, found, [given])), found)
        return list(found.values())

    def _exchange(
        self,
        best: Fit,
        lines: Sequence[Line],
        others: Sequence[Member],
        tried: dict[str, Fit],
        shorter: Sequence[Fit] = (),
    ) -> list[Start]:
        """Fit what does about the same as a member, or what else is missing from shorter fits.

        Return where others that are simpler than a member begin.
        """
        every = range(len(best.hypothesis.members))
        own, *parts = self.glance.fit(
            [restart(best), *(without(best, place) for place in every)], rounds=0
        )
        for rest in {fit.label: fit for fit in (*parts, *shorter)}.values():
            alike = pick_alike(self.glance, own, rest, lines, self.settings.alike)
            self._fit(alike, tried, alike=True)
        return list_simpler(best, others)

    def _fit(self, starts: Sequence[Start], tried: dict[str, Fit], alike: bool = False) -> None:
        """Fit starts into what was tried: at a glance, and the better half of each size fully.

        They may be `alike`, to stand for one another. Windows of another log start elsewhere, so
        that the unknowns around one say little of the other: the best that mends the log and the
        best that leaves it as it is are then fitted fully, too.
        """
        rounds = self.settings.rounds - self.settings.glances
        for count in sorted({len(start.hypothesis.members) for start in starts}):
            own = [start for start in starts if len(start.hypothesis.members) == count]
            fits = self.glance.fit(own, rounds=self.settings.glances)
            fits.sort(key=lambda fit: -fit.density.sum())  # so few windows predict others badly
            most = max(min(len(own), self.settings.refits) // HALVES, 1)
            chosen = [*fits[:most], *(pick_unlike(fits) if alike else [])]
            keep_better(
                self.quick.fit(map(restart, pick_distinct(chosen, len(fits))), rounds), tried
            )


def is_better(fit: Fit, tried: Mapping[str, Fit]) -> bool:
    """Return whether a fit predicts better than what was tried of its label, if anything was."""
    return fit.label not in tried or fit.total > tried[fit.label].total


def keep_better(fits: Iterable[Fit], tried: dict[str, Fit]) -> None:
    """Take the fits that are better into what was tried."""
    tried.update({fit.label: fit for fit in fits if is_better(fit, tried)})
