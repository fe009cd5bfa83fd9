"""The numbers that decide what the search tries, accepts, doubts and reports, with their evidence.

Constants of a numerical method (bins, folds, sign flips, buffer sizes) stand beside their
algorithm.

Each comment ends with the evidence, which is one of three kinds. "Convention": a usual choice of
statistics. "Measured": on simulated sets. "By hand": chosen while the search was built, and never
varied by itself. `results/discovery_rules.csv` tells in how many of 83 campaigns with a cause half
or twice of each would decide otherwise (`experiments.rules`). All rules together were measured by a
study: of 200 sets with nothing hidden 4 had a claim (docs/results.md,
`results/discovery_rates.csv`).

Units: a gain is in units of the log likelihood of runs left out, summed over the runs. A share of
the loss is one of half the number of points, which is the loss that noise alone makes. A run
scatter is the standard deviation of the levels of the runs, relative to the adhesion.
"""

# --- How much is searched ---------------------------------------------------------------------

#: Largest number of effects that one search accepts, one after the other. By hand, to limit the
#: time.
MOST_ROUNDS = 6

#: A probe is not tested if less than this share of its norm remains after projecting out the
#: model's Jacobian. By hand, from a prototype of the search.
LEAST_SHARE_LEFT = 0.03

#: Two columns form no pair if the size of their correlation exceeds this. By hand.
SAME_COLUMN_CORRELATION = 0.98

#: Number of physical causes that are refitted in each round, those of largest score. By hand:
#: refits take most of the time.
TRIED_CAUSES = 6

#: Number of forms of plain columns that are refitted in each round, those of largest score. By
#: hand: refits take most of the time.
TRIED_COLUMNS = 5

#: A candidate is not refitted if its p exceeds the significance level by more than this factor. By
#: hand.
SHORTLISTED_TIMES = 10

#: Number of columns that are combined in pairs, those of largest score. By hand: pairs are many.
PAIRED_COLUMNS = 12

#: Number of columns that are combined with a chosen column, those of largest score. By hand.
PARTNER_COLUMNS = 20

#: Number of pairs of columns, or of refinements of an effect, that are refitted, those of largest
#: score. By hand.
TRIED_FORMS = 3

#: A column is named as one that varies within blocks of rows if this share of its variance does. By
#: hand.
HIDDEN_SHARE = 0.1

# --- When an effect is accepted ---------------------------------------------------------------

#: An effect is accepted only if the p of its columns, adjusted for the whole library, is at most
#: this. Convention: one false claim in a hundred sets with nothing hidden.
SIGNIFICANT = 0.01

#: The same limit for waves and for pairs of columns, which are many. Measured with a prototype of
#: the search: of 32 simulated sets 10 had a wrong extra effect with .001 and 15 with .01.
SCAN_SIGNIFICANT = 0.001

#: A physical cause is accepted only if its gain exceeds zero by more than this number of standard
#: errors. Convention: one-sided 90 %.
SURE_ERRORS = 1.28

#: A plain column is accepted only if its gain exceeds zero by more than this number of standard
#: errors. Convention: one-sided 95 %, stricter because no physics supports it.
SURE_ERRORS_OF_COLUMN = 1.645

#: An effect is accepted only if its gain exceeds this share of the loss, or LEAST_GAIN if that is
#: less. By hand, from a prototype of the search.
LEAST_SHARE_OF_LOSS = 0.003

#: A gain above this is enough, whatever its share of the loss: the more rows, the smaller an effect
#: they make sure. Convention: half a chi-square of one degree of freedom, p = 6e-5.
LEAST_GAIN = 8.0

#: Length of a stretch of a log of one run, in neighbouring blocks. An effect is accepted only if
#: its gain remains sure without the stretch in which it gains most. By hand.
STRETCH_BLOCKS = 3

# --- Which candidate is named -----------------------------------------------------------------

#: One candidate is ahead of another only by more than this number of standard errors: so a plain
#: column is preferred to a physical cause, and a pair of columns to a single one. What is behind by
#: less is in the class of the chosen one. Convention: two-sided 95 %.
AHEAD_ERRORS = 2.0

#: A column must also be ahead by more than this share of its own gain. By hand, from a prototype of
#: the search.
COLUMN_SHARE_OF_GAIN = 0.15

#: A physical cause is named in place of a plain column only if its gain exceeds this share of the
#: column's, though the difference may be within its error. By hand.
CAUSE_SHARE_OF_GAIN = 0.5

#: A cause with a strength at an end of its range is contradicted if beyond that end it would gain
#: more than this share of its gain. By hand.
MUCH_HELD_BACK = 0.10

#: A candidate that is behind by at most this is not surely behind. Convention: two units of
#: support, Edwards 1972.
UNDECIDED_GAIN = 2.0

#: A candidate is in the class only if the cosine between its change of the prediction and that of
#: the chosen one exceeds this. By hand: causes of different parts of the residual may gain as much.
CLASS_COSINE = 0.5

#: A further effect refines the form of an earlier one of its family if it gains less than this
#: share of what that one gained. By hand.
REFINING_SHARE_OF_FAMILY = 0.25

#: A further effect of any family refines the form of an earlier one if it gains less than this
#: share and rests on no column but those of the earlier one, slip, speed and time. By hand: an
#: inexact formula leaves about as much.
REFINING_SHARE = 0.05

#: Largest number of parts of an effect, itself included. By hand.
MOST_PARTS = 4

# --- Waves ------------------------------------------------------------------------------------

#: Fewest waves over the range of a column that are searched. By hand.
FEWEST_WAVES = 3

#: Fewest bins of the transform in each wave that is searched. By hand.
FEWEST_BINS = 8

#: Frequencies with less than this share of the median power are left out. By hand: where only one
#: or two runs have been, the coherence of the runs means nothing.
LEAST_POWER_SHARE = 0.05

#: Half the frequency of the strongest line is reported if the coherence there exceeds this.
#: Convention: it is exponential, and exceeds this by chance with p = exp(-10) = 4.5e-5.
HALF_FREQUENCY_COHERENCE = 10.0

#: A wheelset twists faster than this, Hz. By hand: its modes lie at 30 to 70 Hz.
SLOWEST_TORSION = 5.0

#: Fewest complete runs in which a line in time is searched. By hand.
FEWEST_RUNS_OF_A_LINE = 4

#: A line in time is not searched if the time step varies by more than this share of itself. By
#: hand.
EVEN_STEPS = 0.01

# --- Doubts -----------------------------------------------------------------------------------

#: Boosted trees are not asked if there are fewer runs, nor is a bootstrap over them taken at its
#: word. By hand: two in each of four folds.
FEWEST_RUNS = 8

#: Factor by which the products of residual and prediction are taken to scatter wider than
#: independent ones. Measured: of 900 simulated sets of 28 runs with nothing to find (white noise,
#: AR(1) of .5 to .95, levels that scatter by up to twice the noise) 2 had p <= .002 and 6 p <= .01
#: with it, 10 and 32 without it.
OPINION_WIDENING = 1.3

#: What the trees predict is told as a hint, with its p, if that is at most this. Convention.
OPINION_HINTED = 0.1

#: What the trees predict is reported as missing, and may be added as a correction, if its p is at
#: most this. Measured: 2 of the 900 sets above.
OPINION_SIGNIFICANT = 0.002

# --- What is reported beside the effects ------------------------------------------------------

#: Two causes are reported as acting nearly alike if their cosine reaches this. By hand.
ALIKE_COSINE = 0.9

#: A measurement that would separate two causes is proposed if their cosine reaches this. By hand.
PROPOSED_COSINE = 0.6

#: Test points with a slip beyond that of every training point are warned of above this share. By
#: hand.
FEW_OUTSIDE = 0.01

#: The verdict says that test data are outside the training range above this share of their points.
#: By hand.
MUCH_OUTSIDE = 0.2

#: The verdict says that the error on test data is unlike that on training runs left out if their
#: intervals do not touch. Of fewer than FEWEST_RUNS in either, whose bootstrap is too narrow, the
#: lower end of the one must exceed the value of the other by this factor as well. By hand.
UNLIKE_TRAINING = 2.0

#: The departure of the curve from its formula is reported above this share of the largest adhesion.
#: By hand.
REPORTED_DEPARTURE = 0.01

#: The autocorrelation of the noise is reported above this. By hand.
REPORTED_AUTOCORRELATION = 0.05

#: The run scatter of the noise is reported above this. By hand.
REPORTED_RUN_SCATTER = 0.002

#: A point is an outlier if its whitened residual exceeds this number of standard deviations. By
#: hand: 6e-7 of normal noise does.
OUTLIER_DEVIATIONS = 5.0

#: A dependence of the spread of the noise on adhesion or slip is reported if the p of their rank
#: correlation is below this. By hand: many points make small correlations significant.
NOISE_SIGNIFICANT = 1e-4

#: Outliers, dependence and steps are not reported of fewer points than this. By hand.
FEWEST_POINTS_OF_NOISE = 50

#: Steps of adhesion are reported only if the number of its distinct values is below this share of
#: the number of points. By hand.
STEPPED_SHARE = 0.5

#: Steps of adhesion are reported only if they exceed this share of the standard deviation of the
#: noise. By hand.
REPORTED_STEP = 0.3
