"""The result of a discovery; reports and studies read this and compute nothing new."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd

from adhesion_jax.effects.law import CorrectedLaw


class Interval(NamedTuple):
    """A number and its 95 % interval; NaN bounds where there is none."""

    value: float
    low: float
    high: float


class Errors(NamedTuple):
    """Root mean square error of adhesion before and after; intervals by a bootstrap over runs."""

    before: Interval
    after: Interval
    removed: Interval  # 1 - (after/before)^2
    runs: int


class FoundEffect(NamedTuple):
    """One cause that the law lacked, or a structure without a known cause."""

    name: str  # the most likely: a name of EFFECTS, or covariate:, product: of columns
    candidates: tuple[str, ...]  # names that the data cannot tell from it, the most likely first
    covariates: tuple[str, ...]  # the columns it rests on
    formula: str  # e.g. "mu (1 - k kappa)"
    parameters: Mapping[str, Interval]
    units: Mapping[str, str]
    p_adjusted: float
    rmse_after: float  # of cross-validation, with this effect and those accepted before it
    sentence: str  # what the effect does, in words
    acts_on: str = "level"  # part of the curve: its level, its slip scale ("slip"), its "fall"
    at_bound: tuple[str, ...] = ()  # parameters at an end of the range in which they are looked for
    by_trees: bool = False  # whether p_adjusted is that of boosted trees that need its columns
    refined_on: tuple[str, ...] = ()  # parts of the curve that what refines its form acts on


class Doubt(NamedTuple):
    """A structure in the data that is not counted as an effect, for it may be something else."""

    names: tuple[str, ...]  # effects or columns that would explain it
    sentence: str  # what it may be, and what would decide


class Opinion(NamedTuple):
    """The prediction by boosted trees of the residual of runs that they were not fitted to."""

    columns: tuple[str, ...]  # that the prediction needs, the most important first
    explained: float  # share of the squared residual, outliers cut, of the runs left out
    error: float  # standard error of that share, over runs
    p: float  # of the hypothesis that no column is related to the residual
    #: The residual that the trees predict, [points], from the columns [points] that they know. None
    #: where what they predict is no more than its standard error.
    correction: Callable[[Mapping[str, np.ndarray]], np.ndarray] | None = None


class Candidate(NamedTuple):
    """One row of the ranking: a candidate of one round, and how much it would explain."""

    round: int  # 0 for the first effect
    name: str
    z: float  # of the score test
    p_adjusted: float
    gain: float  # of the cross-validated log likelihood of all runs; NaN if it was not refitted
    gain_se: float
    decision: str  # "accepted", "in the class of ...", "not significant" ...


#: What the dependence of the curve of braking, relative to that of traction, is called.
BRAKING = "braking over traction"


class Dependence(NamedTuple):
    """Partial dependence on one column: the factor on adhesion over its values, or its labels."""

    effect: str
    column: str
    unit: str
    values: np.ndarray  # [grid]
    #: [grid]: adhesion relative to that of the curve alone; of a curve itself, relative to that at
    #: the first value, or of braking to that of traction over the slip.
    factor: np.ndarray
    low: np.ndarray  # [grid]: 95 % band
    high: np.ndarray
    labels: tuple[str, ...] = ()  # the names of the values, [grid], of a column of labels
    #: Of a curve itself, and of what acts on its shape: where it depends most on the column.
    at_slip: float = float("nan")
    told: int = -1  # of a curve itself: the place of the factor that the verdict tells


class Proposal(NamedTuple):
    """The measurement that would separate two causes."""

    between: tuple[str, str]
    measurement: str  # a sentence
    power: float  # expected separation, in standard errors


class Findings(NamedTuple):
    """Everything that a report needs."""

    source: str  # the name of the data
    base: str
    base_parameters: pd.DataFrame  # parameter, unit, before, before_se, after, after_se
    law: CorrectedLaw  # base and effects, fitted to all runs
    law_before: CorrectedLaw  # the best curve without effects, fitted to all runs
    noise_floor: float
    noise: Mapping[str, float]  # sigma, autocorrelation, run_scatter
    train: Errors
    validation: Errors  # cross-validation over the runs of the training data
    test: Errors | None
    effects: tuple[FoundEffect, ...]
    unexplained: tuple[FoundEffect, ...]
    ranking: tuple[Candidate, ...]
    confounded: tuple[str, ...]  # sentences: which causes the data cannot tell apart, and why
    untested: tuple[str, ...]  # sentences: columns absent, constant or too narrow
    proposals: tuple[Proposal, ...]
    dependences: tuple[Dependence, ...]
    warnings: tuple[str, ...]
    #: One row a point of the search, a training row or the mean of a block of neighbouring ones:
    #: run, slip, adhesion, before, after, every column.
    points: pd.DataFrame
    #: With a test set, one row a row of it that is used: row (its number among these), run, time_s
    #: if there is one, slip, adhesion, then its prediction: base, corrected (by the law that is
    #: saved), and with_trees if asked for.
    predictions: pd.DataFrame | None
    seconds: float
    #: The z of the score test whose adjusted p equals the significance level, by round; NaN or left
    #: out if that z is not known.
    thresholds: tuple[float, ...] = ()
    #: The kind of slip of the points: slip_ratio or slip_velocity_mps.
    slip: str = "slip_ratio"
    citation: str = ""  # of the data
    doubts: tuple[Doubt, ...] = ()
    #: What boosted trees predict of the residual of the law; None if that may be chance.
    opinion: Opinion | None = None
    #: One row a run: run, before, after (its mean relative residual, without and with the effects),
    #: error (standard error of either, from the noise within the run), mean of every column. None
    #: for blocks of one run. A column of labels is there if none changes within a run.
    levels: pd.DataFrame | None = None
    #: The labels of the columns that have some, in the order of their codes in points and levels.
    named: Mapping[str, tuple[str, ...]] = {}
    #: The warnings that the verdict repeats: that the law is not the one that is saved, and what
    #: much of the test data has that the training data hardly cover.
    foremost: tuple[str, ...] = ()
    least_p: float = 0.0  # the smallest p that signs of the runs can show
    #: The errors of the curve alone (before) and of the law with the trees of the opinion on top
    #: (after) on the test set; None if that was not asked for, or if the trees predict nothing.
    with_trees: Errors | None = None
    #: The errors on the test set of the curve alone (before) and of the law with boosted trees on
    #: top (after), whether or not what they predict is likely chance. None for few runs, and where
    #: the curve alone is saved.
    beside_trees: Errors | None = None
    #: Where the slip was smoothed: the errors of the curve alone with the slip as measured (before)
    #: and with the smoothed one (after), on the test set, or else on runs left out.
    smoothing: Errors | None = None
