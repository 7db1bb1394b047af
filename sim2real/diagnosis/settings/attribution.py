"""Settings of `diagnosis/attribution`: the search for causes."""

from __future__ import annotations

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, DEVELOPED, JUDGED, ROUNDING, setting

RACE = (
    "measured: case_000 of seed 2217 (docs/thirdparty.md), where the truth, 15th by its promise, "
    "never raced; it closes 0.973, what won among ten 0.942"
)
CALIBRATED = "tuned: on robots of another engine (docs/thirdparty.md), seeds 2218 and 79"


@dataclass(frozen=True)
class Search:
    """The forward and backward search."""

    causes_max: int = setting(4, "1", "causes in all", DEVELOPED)
    exchanges: int = setting(
        4, "1", "exchanges of a cause for another at most, when each is looked at again", COST
    )
    screening_s: float = setting(9.0, "s", "windows that screening uses", COST)
    racing_s: float = setting(15.0, "s", "windows that the race uses", COST)
    fitting_s: float = setting(40.0, "s", "windows that a winner is fitted to", COST)
    final_s: float = setting(90.0, "s", "windows of the last fit", COST)
    final_rounds: int = setting(4, "1", "steps of the last fit", COST)
    rest_rounds: int = setting(2, "1", "steps of a fit without one cause", COST)
    shown: float = setting(
        0.5, "1", "squared error, of the windows that show it best, to keep the others", DEVELOPED
    )
    race: tuple[tuple[int, int], ...] = setting(
        ((24, 0), (8, 0), (6, 1), (4, 1)),
        "1",
        "candidates of each round of the race, and steps; without steps each is only simulated, "
        "in the first round in longer time steps",
        RACE,
    )
    lagging: float = setting(
        0.25,
        "1",
        "share of what the best contender closes, below which nobody goes on to the next round",
        "judgement: half of `judged`, since a round's steps may gain as much",
    )
    judged: float = setting(
        0.5,
        "1",
        "share of what the best contender closes, and of the gap that it closes, from which those "
        "below are not judged",
        "derived: twice `Causes.equal_unsure`, from which nobody is an equal",
    )
    settled_rounds: int = setting(6, "1", "steps of a winner's fit at most", COST)
    spread: tuple[float, ...] = setting(
        (1.0, 0.55, 1.7), "1", "starts of a fit, as multiples of the guess", DEVELOPED
    )
    promise_first: float = setting(
        0.03, "1", "share of the squared error that screening must promise, first cause", DEVELOPED
    )
    promise_later: float = setting(0.1, "1", "the same for further causes", DEVELOPED)
    suspect: float = setting(
        0.03, "1", "share of the gap below which a joint is not suspected", DEVELOPED
    )
    worth: float = setting(0.04, "1", "share of the first gap that a cause must close", DEVELOPED)
    worth_floors: float = setting(0.25, "1", "fall of the gap that counts, in floors", DEVELOPED)
    alone: float = setting(
        0.93, "1", "share of the gap from which one effect is taken to be alone", DEVELOPED
    )
    pairs: tuple[int, ...] = setting(
        (12, 6, 3, 2),
        "1",
        "pairs fitted on more and more windows, the last ones judged on held-out ones",
        "measured: of a real XL330 a low gain and friction under load, 0.80 closed, were the ninth "
        "pair; 0.57 with eight",
    )
    done_floors: float = setting(1.3, "1", "gap in floors at which the search ends", DEVELOPED)
    heavy: float = setting(
        0.9, "1", "share of the windows that count fully, however large their error", DEVELOPED
    )
    stride: int = setting(
        7, "1", "shift from which windows are spread", "derived: any number without common factors"
    )


@dataclass(frozen=True)
class Cogging:
    """Ripples that the error shows."""

    counts: tuple[float, float] = setting(
        (3.0, 150.0), "1", "ripples in a turn: fewest and most", JUDGED
    )
    finest: float = setting(4.0, "1", "counts tried in a difference that the span resolves", JUDGED)
    readings: float = setting(1.5, "1", "encoder counts in half a ripple, at least", JUDGED)
    counts_probed: int = setting(3, "1", "counts probed by simulation", COST)
    sizes: tuple[float, ...] = setting(
        (1.0, 2.5), "1", "probed amplitudes, of the one in the error", DEVELOPED
    )
    slow: float = setting(0.7, "rad/s", "faster rows are ignored", DEVELOPED)
    turned: float = setting(0.8, "rad", "a joint that turned less shows only a mean", DEVELOPED)
    trend_order: int = setting(3, "1", "degree of the polynomial beside a ripple", DEVELOPED)
    stiffness_min: float = setting(0.1, "N·m/rad", "least stiffness of a servo", JUDGED)
    rows_min: int = setting(50, "1", "rows needed", JUDGED)
    off_share: float = setting(0.05, "1", "windows without torque for longer are left out", JUDGED)


@dataclass(frozen=True)
class TorqueOn:
    """When rows with torque are searched by themselves."""

    closed: float = setting(0.6, "1", "share of the gap under torque to be closed", DEVELOPED)
    explained: float = setting(0.9, "1", "share of the gap from which it is not tried", DEVELOPED)
    explained_floors: float = setting(2.0, "1", "gap in floors at which it is not tried", DEVELOPED)
    harm: float = setting(
        2.0, "1", "squared error without torque that contradicts, of that before", DEVELOPED
    )
    simpler: float = setting(
        1.25, "1", "how much worse one cause may be than several, under torque", DEVELOPED
    )
    windows_min: int = setting(4, "1", "windows needed with torque", JUDGED)


@dataclass(frozen=True)
class JointGroups:
    """When one kind of effect is tried at every joint, and what of it stays."""

    joints_min: int = setting(3, "1", "joints of a gap that is spread, and of a kind", DEVELOPED)
    joint_floors: float = setting(4.0, "1", "floors from which a joint counts there", DEVELOPED)
    poor: float = setting(0.8, "1", "closed share below which kinds are tried", DEVELOPED)
    better: float = setting(0.1, "1", "share of the gap that kinds must close beyond", DEVELOPED)
    families_max: int = setting(3, "1", "rounds in which kinds join", COST)
    tried: int = setting(3, "1", "kinds, or pairs of them, fitted in a round", COST)
    windows_s: float = setting(80.0, "s", "windows used: joints move in turn", COST)
    points: int = setting(24, "1", "simulations of a round of each joint's own search", COST)
    rounds: int = setting(2, "1", "rounds of that search for each kind tried", COST)
    further_rounds: int = setting(4, "1", "rounds added for the best one", COST)
    final_rounds: int = setting(2, "1", "Gauss-Newton steps of the kinds together", COST)
    spread: float = setting(0.7, "1", "logarithm of a first round's random factors", DEVELOPED)
    shrink: float = setting(0.7, "1", "by which it shrinks from round to round", DEVELOPED)
    coarse: tuple[float, ...] = setting(
        (0.2, 0.07, 0.025, 0.01),
        "1",
        "factors tried besides the probes: data sheets are off by orders of magnitude",
        DEVELOPED,
    )
    worth: float = setting(0.02, "1", "share of the first gap that a kind closes", DEVELOPED)


@dataclass(frozen=True)
class Parsimony:
    """What a further value has to close at a joint, on windows that it was not fitted to.

    The largest of the three is its price. Joint by joint, since of thirty joints none closes much
    of the whole; of what is left, since where a law is wrong any other value mends some of it.
    """

    floors: float = setting(0.25, "1", "noise floors of the joint", JUDGED)
    share: float = setting(
        0.1,
        "1",
        "share of what there is to close at the joint",
        "derived: what `explained` leaves open is no cause either",
    )
    mends: float = setting(
        0.25, "1", "share of what is left at the joint: less may only mend a bad fit", JUDGED
    )
    share_kept: float = setting(
        0.2, "1", "of a price, from which a share stays between its ends", JUDGED
    )
    kept: int = setting(3, "1", "values that pay, from the cheapest on, that end the look", COST)
    reach: float = setting(
        0.5,
        "1",
        "share of what is closed that effects of the whole robot must promise, to be sought alone",
        "judgement: a promise is a straight line, no fit; not studied",
    )


@dataclass(frozen=True)
class Verdict:
    """When a gap is one, and when it is explained."""

    no_gap_floors: float = setting(2.0, "1", "noise floors within which there is no gap", DEVELOPED)
    no_gap_counts: float = setting(2.0, "1", "encoder counts within which there is none", JUDGED)
    joint_floors: float = setting(3.0, "1", "floors from which one joint stands out", DEVELOPED)
    joint_counts: float = setting(1.5, "1", "counts from which one joint stands out", DEVELOPED)
    explained: float = setting(0.9, "1", "closed share from which it is explained", JUDGED)
    sole: float = setting(
        0.95,
        "1",
        "closed share from which one cause explains, lower bound `explained`, whatever is left",
        "tuned: on the third-party calibration half right single causes that leave something "
        "close 0.96 and more of the scorer's log; of 44 withheld effects a wrong single one closed "
        "at most 0.85",
    )
    resolved: float = setting(
        0.85,
        "1",
        "closed share from which one cause explains that leaves no joint further off than "
        "`explained_counts`",
        "measured: right single causes of small gaps close 0.86 to 0.89, since what a sound robot "
        "leaves of a count is as much of a small gap; of withheld effects a wrong single one at "
        "most 0.85",
    )
    explained_floors: float = setting(
        3.0,
        "1",
        "floors of a joint that lastingly left errors may have where nine tenths are closed",
        "derived: `joint_floors`, from which a single joint stands out",
    )
    explained_counts: float = setting(
        1.15,
        "1",
        "encoder counts that they may have instead",
        "tuned: about what the encoder resolves; on robots of another engine right single causes "
        "leave up to 1.05 at a joint, laws outside the vocabulary 1.26 and more",
    )
    lasting_s: float = setting(
        0.01, "s", "time after which an error that is still there is no noise of a row", JUDGED
    )
    partly: float = setting(0.3, "1", "closed share from which it is partly explained", JUDGED)
    causes_max: int = setting(
        4, "1", "causes of an explanation; more are a fit", "convention: of the report's schema"
    )
    joint_causes_max: int = setting(
        2,
        "1",
        "causes at one joint of an explanation; more explain a part at best",
        "measured: two answers of all exams explained a gap by three at one joint, both in the "
        "place of an effect that was withheld (docs/blindcheck.md)",
    )


@dataclass(frozen=True)
class Causes:
    """Shares, equivalents, confidence and intervals of causes."""

    subsets_max: int = setting(5, "1", "causes of which every subset is fitted", COST)
    subset_rounds: int = setting(2, "1", "steps of a subset's fit", COST)
    equal_share: float = setting(
        0.05, "1", "a rival this close, of what the cause closes, is equivalent", DEVELOPED
    )
    equal_worth: float = setting(
        0.2, "1", "the same limit where the floor is larger, of what the cause closes", DEVELOPED
    )
    equal_unsure: float = setting(
        0.25, "1", "the same where the bootstrap cannot decide which is better", DEVELOPED
    )
    equivalents_max: int = setting(
        3,
        "1",
        "members of an equivalence set, the cause included",
        "derived: what the exam counts as a set",
    )
    look_alike: float = setting(
        0.95, "1", "cosine of two changes of the simulation from which both are fitted", JUDGED
    )
    look_alikes_max: int = setting(2, "1", "effects fitted in a cause's place", COST)
    twin_near: float = setting(
        0.3, "1", "distance of fitted twins in all states, of what one changes there", JUDGED
    )
    twin_same: float = setting(1e-6, "1", "the same where one's values are the nearest", ROUNDING)
    unrivalled: float = setting(
        0.5, "1", "chance of winning without rivals", "derived: a coin's, nothing is known"
    )
    sure_max: float = setting(
        1.0, "1", "confidence of a cause that always wins, if a known law is behind", CALIBRATED
    )
    rival_doubt: float = setting(0.25, "1", "confidence lost to a rival next to it", CALIBRATED)
    rival_margin: float = setting(
        0.1, "1", "distance over which that falls to 1/e, of what is closed", DEVELOPED
    )
    rival_excess: float = setting(
        0.5, "1", "the same of what the cause leaves, if that is nearer to 0", CALIBRATED
    )
    calibration: tuple[float, float] = setting(
        (-2.76, 2.37),
        "1",
        "log odds that a known law is behind a gap: intercept, and slope over -log of the share "
        "of the gap that stays open",
        "tuned: logistic regression on 56 answers about robots of another engine "
        "(python -m benchmarks.confidence)",
    )
    usual_error: float = setting(
        0.03, "1", "error of any model's masses, friction and gains", "convention: a few per cent"
    )
    usual_doubt: float = setting(
        0.5, "1", "confidence lost by what closes no more than such errors make", JUDGED
    )
    usual_clear: float = setting(
        2.0, "1", "times their gap from which a cause loses none", "convention: of a dominant cause"
    )
    usual_causes: int = setting(
        3,
        "1",
        "causes of an explanation from which each has to close more than such errors make",
        "measured: one sealed robot of another engine with usual errors alone was explained, by "
        "four small causes (docs/thirdparty.md)",
    )
    confidence_min: float = setting(0.01, "1", "least confidence", JUDGED)
    confidence_max: float = setting(0.99, "1", "largest confidence", JUDGED)
    left_min: float = setting(
        1e-6, "1", "least square that a cause closes, of what is left", ROUNDING
    )
    doubt: float = setting(
        0.6,
        "1",
        "part of what is left that may act like a cause, half-width of its interval",
        CALIBRATED,
    )
    doubt_min: float = setting(0.005, "1", "least relative half-width", DEVELOPED)
    factor_doubt_min: float = setting(0.01, "1", "least half-width of factors", DEVELOPED)
    ridge: float = setting(1e-9, "1", "added to the curvature, of its trace", ROUNDING)
    ridge_floor: float = setting(1e-30, "1", "added besides", ROUNDING)
    off_share: float = setting(0.05, "1", "windows without torque for longer are a part", JUDGED)
    part_windows_min: int = setting(2, "1", "windows of a part", JUDGED)
    helps: float = setting(0.1, "1", "gain in a part that surely helps", DEVELOPED)
    harms: float = setting(0.25, "1", "loss in a part that surely harms", DEVELOPED)


@dataclass(frozen=True)
class Locating:
    """Where the gap lies."""

    lift: float = setting(
        1.2, "1", "share of the error, of its share of the time, that is worth naming", JUDGED
    )
    share_min: float = setting(0.2, "1", "share of the error worth naming", JUDGED)
    named_max: int = setting(4, "1", "kinds of moments named a joint", JUDGED)
    edges_hz: tuple[float, ...] = setting(
        (0.0, 0.5, 2.0, 5.0, 15.0), "Hz", "edges of the frequency bands", JUDGED
    )


@dataclass(frozen=True)
class Residual:
    """What the rest looks like."""

    found: float = setting(
        0.03, "1", "share of the squared rest that a free-form model must catch", JUDGED
    )
    ridge: float = setting(
        1e-2,
        "1",
        "ridge of the free-form model, of its mean variance",
        "measured: of 1e-4 to 1e-1 best for three of four effects in 24 s logs of the tests' arm",
    )
    spread_min: float = setting(1e-9, "rad", "least spread of a joint's motion", ROUNDING)
    speed: float = setting(3.0, "1/s", "speed that counts as 1, of the motion's spread", JUDGED)
    acceleration: float = setting(10.0, "1/s", "acceleration that counts as 1, of speeds", JUDGED)
    sign: float = setting(5.0, "1", "steepness of the sign of a speed", JUDGED)
    wave: float = setting(3.0, "1", "frequency of the sine of a position, of its spread", JUDGED)
    feature_max: float = setting(10.0, "1", "larger features count as this", JUDGED)
    lags_s: tuple[float, ...] = setting(
        (0.03, 0.1, 0.3), "s", "lags of motions and commands that the free-form model knows", JUDGED
    )
    plays: tuple[float, ...] = setting(
        (0.01, 0.05, 0.2), "1", "its play operators' widths, of a motion's spread", JUDGED
    )
    decays_s: tuple[float, ...] = setting(
        (1.0, 10.0), "s", "time constants of its leaky integrals", JUDGED
    )
    noise_floors: float = setting(2.0, "1", "floors within which the rest is noise", JUDGED)
    constant: float = setting(0.6, "1", "share of a window's mean that is constant", JUDGED)
    fast: float = setting(0.3, "1", "share of squared differences that is fast", JUDGED)
    moving: float = setting(0.3, "1/s", "speed in motion, of the motion's spread", JUDGED)
    off_share: float = setting(0.05, "1", "windows without torque for longer", JUDGED)
    rows_min: int = setting(5, "1", "rows that a mean needs", JUDGED)
