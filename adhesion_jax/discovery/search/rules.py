"""The numbers that decide what the search tries, accepts, doubts and reports, with their evidence.

Constants of a numerical method (bins, folds, sign flips, buffer sizes) stand beside their
algorithm; three that decide about the noise stand in `model`, which imports nothing of the search:
`fitting._MOST_SQUARES_TIMES`, `slip._NOTICEABLE` and `slip._SIGNIFICANT`.

The evidence at the end of each comment is one of three kinds. A convention of statistics. A
measurement on simulated sets. Or "by hand": chosen while the search was built and never varied by
itself. All rules together were measured by studies: of twice 200 sets with nothing hidden 1 and 3
had a claim (README.md, `results/discovery_rates.csv` and `results/discovery_fresh_rates.csv`).

Units: a gain or a loss is in units of the log likelihood; a share of the loss is one of half the
number of points, which is the loss that noise alone makes; a run scatter is the standard deviation
of the levels of the runs, relative to the adhesion.
"""

# --- How much is searched ---------------------------------------------------------------------

#: Share of the runs on which no effect is selected; an effect must raise their likelihood as well.
#: Convention: a quarter is held out.
SHARE_HELD_OUT = 0.25

#: The search is repeated without the effects that the held-out runs reject, at most so often. By
#: hand: it limits the time.
MOST_SEARCHES = 3

#: Largest number of effects that one search accepts one after the other. By hand: it limits the
#: time.
MOST_ROUNDS = 6

#: If the base curve's run scatter is still larger than this after a search, the search is repeated
#: with every point weighted alike. By hand, on simulated sets whose causes act from run to run.
WIDE_RUN_SCATTER = 0.1

#: The repeated search replaces the first one if its sum of squared errors of the held-out runs is
#: below this share of the first one's. By hand.
CLEARLY_FEWER_SQUARES = 0.8

#: If the autocorrelation or the run scatter of the noise reaches these values, the residual is
#: screened a second time as if its noise were white. By hand.
COLOURED_AUTOCORRELATION = 0.15
COLOURED_RUN_SCATTER = 0.025

#: A probe is not tested if less than this share of its norm remains after projecting out the
#: model's Jacobian. By hand, taken over from a prototype of the search.
LEAST_SHARE_LEFT = 0.03

#: Two columns whose correlation exceeds this form no pair. By hand.
SAME_COLUMN_CORRELATION = 0.98

#: A column is searched for waves if the number of its distinct values exceeds this share of the
#: number of points. By hand: a wave along a few levels means nothing.
CONTINUOUS_SHARE = 0.5

#: Number of physical causes, and of forms of plain columns, that are refitted in each round: those
#: of largest score. By hand: refits take most of the time.
TRIED_CAUSES = 6
TRIED_COLUMNS = 5

#: A candidate is refitted only if its p is at most this many times the significance level: a refit
#: can gain more than its score test promised. By hand.
SHORTLISTED_TIMES = 10

#: A refitted candidate gets a noise of its own if its gain is at least this share of the largest
#: one. By hand: a noise of its own may treble the gain of a cause that acts from run to run, but
#: seldom makes ten times of it.
CONTENDING_SHARE = 0.1

#: Number of columns that are combined in pairs; number of columns that are combined with a column
#: that was chosen; number of pairs, of largest score, that are refitted. By hand: pairs are many.
PAIRED_COLUMNS = 12
PARTNER_COLUMNS = 20
TRIED_PAIRS = 3

#: A part of the model is not tried to be left out if that would raise half the deviance by more
#: than this, to second order. By hand: a part that is so clearly needed never fails the test.
PLAINLY_NEEDED = 50.0

#: If the BIC of a base curve with the effects exceeds the smallest one by more than this, the curve
#: is not fitted to all runs. By hand: a third more runs do not turn such a difference.
HOPELESS_BIC = 100.0

# --- When an effect is accepted ---------------------------------------------------------------

#: An effect is accepted if its p, adjusted for the whole library, is at most this. Convention: 1 %,
#: so that one null set in a hundred has a claim by the score test alone.
SIGNIFICANT = 0.01

#: The same for waves and for pairs of columns, which are many. Measured with a prototype of the
#: search: of 32 simulated sets 10 had a wrong extra effect with .001, 15 with .01.
SCAN_SIGNIFICANT = 0.001

#: The p of effects that are fitted outright, beside the score tests, is multiplied by this: they
#: add at most one in so many to the false claims. By hand.
OUTRIGHT_TIMES = 500

#: The gain on runs left out must exceed zero by so many of its standard errors. Convention:
#: one-sided 90 % for a physical cause; one-sided 95 % for a plain column, for which no physics
#: speaks.
SURE_ERRORS = 1.28
SURE_ERRORS_OF_COLUMN = 1.645

#: The gain must also exceed this share of the loss. By hand, taken over from a prototype.
LEAST_SHARE_OF_LOSS = 0.003

#: In a log of one run the gain must remain without any so many neighbouring blocks, one stretch of
#: the log. By hand.
STRETCH_BLOCKS = 3

#: An effect found below a curve that does not fall with speed replaces the absence of one below a
#: curve that does if it raises the log likelihood by more than this. Convention: two units of
#: support, Edwards 1972.
LEAST_GAIN_OF_PLAINER = 2.0

#: An effect is dropped if it lowers the error of held-out runs in less than this share of the
#: bootstrap samples of them. Convention: more often than not.
LEAST_SHARE_RAISED = 0.5

#: All effects are dropped if with them the sum of squared errors is more than this many times that
#: of the best curve alone. By hand: 1 % for the fit under another noise.
MOST_SQUARES_TIMES = 1.01

# --- Which candidate is named -----------------------------------------------------------------

#: A plain column is preferred to a physical cause, and a pair of columns to a single one, only if
#: it is ahead by more than so many standard errors, this share of the loss and this share of its
#: own gain. Errors by convention (two-sided 95 %), shares by hand, taken over from a prototype.
COLUMN_ERRORS = 2.0
COLUMN_SHARE_OF_LOSS = 0.01
COLUMN_SHARE_OF_GAIN = 0.15

#: If a physical cause reaches more than this share of the gain of the plain column that it rests
#: on, the cause is named: its formula is inexact, not its column. By hand.
SAME_CAUSE_SHARE = 0.5

#: Two candidates are one class, which the data do not separate, if their gains differ by at most
#: so many standard errors and this share of the larger gain; of one family, by at most the other
#: share. Errors by convention (two-sided 95 %), shares by hand.
CLASS_ERRORS = 2.0
CLASS_SHARE = 0.10
CLASS_SHARE_OF_FAMILY = 0.25

#: They are one class however small the gain if the log likelihoods differ by at most this.
#: Convention: two units of support, Edwards 1972.
UNDECIDED_GAIN = 2.0

#: They are one class only if the cosine of their changes of the prediction exceeds this. By hand:
#: two causes that explain different parts of the residual may gain as much.
CLASS_COSINE = 0.5

#: A pair of columns is replaced by two effects of a column each if these reach this share of its
#: gain. By hand.
SEPARATE_SHARE = 0.75

#: A further effect that gains less than this share of an earlier one of its family refines the form
#: of that one. By hand.
REFINING_SHARE_OF_FAMILY = 0.25

#: So does a further effect of any family that gains less than this share, if it rests on no column
#: but those of the earlier one, slip, speed and time: an inexact formula leaves so much. By hand.
REFINING_SHARE = 0.05

#: Largest number of parts of an effect: the effect and its refinements. By hand.
MOST_PARTS = 4

#: Number of refinements, of largest score, that are refitted to choose one. By hand.
TRIED_PARTS = 3

#: A refinement must gain more than so many standard errors and this share of the loss. By hand: it
#: is no claim of its own.
PART_ERRORS = 1.0
PART_SHARE_OF_LOSS = 0.001

#: A harmonic of a wave is not tried again if the effect has one whose number is within this of it.
#: By hand.
SAME_HARMONIC = 0.2

# --- Waves ------------------------------------------------------------------------------------

#: Fewest waves over the range of a column, and fewest bins of the transform in each wave, between
#: which waves are looked for. By hand.
FEWEST_WAVES = 3
FEWEST_BINS = 8

#: Frequencies with less than this share of the median power are left out: where only one or two
#: runs have been, the coherence of the runs means nothing. By hand.
LEAST_POWER_SHARE = 0.05

#: If the coherence at half the frequency of the strongest line exceeds this, half the frequency is
#: reported. Convention: by chance, exponential, this happens with p = exp(-10) = 4.5e-5.
HALF_FREQUENCY_COHERENCE = 10.0

#: A line in time must go through so many waves in a run: slower ones belong to the excitation. By
#: hand.
WAVES_OF_A_LINE = 6

#: A line in time is looked for in so many complete runs or more. By hand.
FEWEST_RUNS_OF_A_LINE = 4

#: It is not looked for if the time step varies by more than this share of itself. By hand.
EVEN_STEPS = 0.01

# --- Doubts -----------------------------------------------------------------------------------

#: An effect of slip alone becomes a doubt if with any base curve its log likelihood ratio is below
#: this. Convention: half a chi-square of one degree of freedom, p = 6e-5.
GAIN_ON_EVERY_CURVE = 8.0

#: Falling friction is a doubt where the curve chosen falls by itself if the effect on another curve
#: reaches this share of what the chosen curve gains. By hand.
SHARE_OF_FALLING_CURVE = 0.75

#: A candidate that gains more than so many standard errors and was not accepted in a log fails by
#: resting on one stretch of it, and the doubt says so. Convention: one-sided 95 %.
SURE_BUT_FOR_A_STRETCH = 1.645

#: The levels of the runs are not compared with the columns if the run scatter is below this. By
#: hand.
NOTICEABLE_RUN_SCATTER = 0.005

#: They are not compared with the columns of fewer runs than this. By hand: a polynomial of the
#: third degree would follow them.
FEWEST_RUNS_OF_LEVELS = 10

#: Boosted trees need so many runs. By hand: two in each of four folds.
FEWEST_RUNS_OF_OPINION = 8

#: What the trees see is reported if its p is at most this. By hand, beside the next rule.
OPINION_SIGNIFICANT = 0.002

#: The products of residual and prediction are taken to scatter this many times as wide as
#: independent ones. Measured: of 3,000 simulated sets of 28 runs with nothing to find (white noise,
#: AR(1) of .3 to .95, levels that scatter by up to twice the noise) 4 had p <= .002 and 27 p <= .01
#: with it, 23 and 64 without it.
OPINION_WIDENING = 1.2

#: A column is named by the trees if its p, adjusted for all columns, is at most this. Convention:
#: 1 %.
OPINION_NAMED = 0.01

# --- What is reported beside the effects ------------------------------------------------------

#: Two causes are reported as acting alike from the first cosine on; from the second a measurement
#: is proposed that would separate them. By hand.
ALIKE_COSINE = 0.9
PROPOSED_COSINE = 0.6

#: Number of rivals of an effect for which a measurement is proposed. By hand.
PROPOSED_RIVALS = 2

#: The autocorrelation, the run scatter and the share of outliers of the noise are reported above
#: these values. By hand: below them they matter little for the intervals.
REPORTED_AUTOCORRELATION = 0.05
REPORTED_RUN_SCATTER = 0.002
REPORTED_OUTLIERS = 5e-4

#: A point is an outlier if its whitened residual exceeds this many standard deviations. By hand:
#: 6e-7 of normal noise does.
OUTLIER_DEVIATIONS = 5.0

#: A dependence of the spread of the noise on adhesion or slip is reported if the p of the rank
#: correlation is below this. By hand: many points make small correlations significant.
NOISE_SIGNIFICANT = 1e-4

#: Outliers, dependence and steps are not looked for in fewer points than this. By hand.
FEWEST_POINTS_OF_NOISE = 50

#: Adhesion is looked at for steps if the number of its distinct values is below this share of the
#: number of points. By hand.
STEPPED_SHARE = 0.5

#: Steps of adhesion are reported if they exceed this share of the standard deviation of the noise.
#: By hand.
REPORTED_STEP = 0.3
