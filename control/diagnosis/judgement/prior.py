"""Declares the priors: every number on which a judgement depends, with its reason.

A group of channels (shaft; metering; speed; heads) is faulty with probability `FAULT_PROB`. Every
effect of the group has the same odds, and its time course has the shares of `COURSE_PROBS`. Its
size is distributed around 0 with the scale `usual` of the effect's row
(control/diagnosis/effects.py) and the tails of a Cauchy distribution, because a machine may have
ten times the usual size. Such a prior is a normal of unknown s.d. (Andrews and Mallows, JRSS B 36,
1974, 99); here the s.d. is the best-fitting, not below `usual`, and the lower prior weight of a
larger s.d. is included. Begin and end times are uniform over the log.
"""

from __future__ import annotations

from math import erf, exp, inf, log, log1p, pi, sqrt

from topdress.control.machine.term_forms import Form
from topdress.control.machine.terms import TermTarget

# Posterior probability from which a cause is named.
MIN_NAMED_PROB = 0.9
# Log odds against no effect from which an effect is reported.
MIN_REPORT_LOG_ODDS = log(MIN_NAMED_PROB / (1.0 - MIN_NAMED_PROB))
# Prior probability that a group of stages has a fault on a machine that is diagnosed.
FAULT_PROB = 0.3
# Prior shares of a fault's time course: most faults existed before the log began.
COURSE_PROBS = {"steady": 0.7, "begins": 0.15, "grows": 0.075, "ends": 0.075}
# Prior probability that a column is in another unit than its file says, or of the other side of a
# gear.
WRONG_UNIT_PROB = 0.03
# Logarithms of the smallest and largest factor of a mistaken unit (gears 2 up, turns a second 60),
# in both directions.
UNIT_FACTOR_LOGS = log(2.0), log(1000.0)
# Prior probability that a log writes readings a row late, or commands a row early, without any
# other sign.
WRONG_ROW_PROB = 0.03
# Prior probability that a loss or delay is smaller than the machine file's: one in fifty.
WRONG_SIGN_PROB = 0.02
# Prior probability of a dependence that no effect describes, shared over quantities, variables and
# forms.
UNKNOWN_PROB = 0.03
# Prior probability that an effect holds in one label or table only, though others could show it:
# one in ten.
LOCAL_PROB = 0.1
# Prior probability that a bench table has one setting that was set or noted wrongly.
WRONG_SETTING_PROB = 0.03
# Prior probability that one row of a bench table was misread: one table in ten.
MISREAD_PROB = 0.1
# Prior standard deviation of a term's coefficients over the spread of its variable, in its
# quantity's unit.
TERM_SDS = {
    TermTarget.SHAFT_PERCENT: 3.0,
    TermTarget.SHAFT_RPM: 3.0,
    TermTarget.GATE_MM: 1.5,
    TermTarget.FLOW_PERCENT: 6.0,
    TermTarget.SCALE_KG: 1.0,
    TermTarget.WHEEL_PERCENT: 3.0,
}
# Share of an effect's own signal by which its form may differ from the catalogue's.
FORM_SHARE = 0.25
# Ratio of the true error of a size to its fitted s.d., by which an interval and the probability of
# a name allow for errors of the model itself: split conformal prediction asks for 1.1 to 1.9 on
# training logs.
SIZE_ERROR = 1.5
# Ratio of the standard deviation of a normal variable to its median absolute deviation.
ROBUST_SD = 1.4826
# Standard normal quantile: nine values in ten are above the mean minus this many s.d.
ONE_SIDED_90_QUANTILE = 1.2816
# Distance of two hypotheses in s.d. at which nine measurements in ten separate them.
SEPARATION_SD = sqrt(2.0 * MIN_REPORT_LOG_ODDS) + ONE_SIDED_90_QUANTILE
# Posterior probability from which a rival is listed.
MIN_LISTED_PROB = 0.02


def name_course(onset_s: float | None, until_s: float | None, grows: bool) -> str:
    """Return the key of a time course in COURSE_PROBS."""
    if onset_s is None:
        return "steady"
    return "grows" if grows else "begins" if until_s is None else "ends"


def calc_log_prior_odds(course: str, names: int) -> float:
    """Return the log prior odds of one effect of `names`, in addition to other effects."""
    return log(FAULT_PROB * COURSE_PROBS[course] / max(1, names))


def calc_sign_log_prior(size: float, only_adds: bool) -> float:
    """Return the correction of a symmetric prior for the sign of a size: one sign is rare for an
    effect that only adds."""
    if not only_adds or size == 0.0:
        return 0.0
    return log(2.0 * (WRONG_SIGN_PROB if size < 0.0 else 1.0 - WRONG_SIGN_PROB))


def calc_size_confidence(size: float, sd: float) -> float:
    """Return the probability that a size is not 0 and has its sign: a name is no more probable
    than the interval of its size excludes 0.

    Parameters
    ----------
    size, sd : a size and the s.d. of its error, in one unit; tolerances, variation and errors of
        the model included.
    """
    return erf(abs(size) / (sd * sqrt(2.0))) if sd > 0.0 else 1.0


def find_size_sd(size: float, usual: float) -> float:
    """Return the s.d. of the normal distribution that approximates a size's prior near that
    size."""
    return max(usual, abs(size))


def find_size_log_weight(size: float, usual: float) -> float:
    """Return the logarithm of the weight of that normal distribution."""
    return log(usual / find_size_sd(size, usual))


def calc_unit_log_odds(ratio: float, usual: float, names: int) -> float:
    """Return the log odds that a reading is `ratio` times its command because of different units,
    against a steady gain effect.

    The gain effect is one of `names`, with a Cauchy prior of scale `usual` for its size (both in
    %).
    """
    low, high = UNIT_FACTOR_LOGS
    if not low < abs(log(ratio)) < high:
        return -inf
    percent = 100.0 * (ratio - 1.0)
    # Density per unit of the ratio's logarithm.
    by_effect = usual / (pi * (usual**2 + percent**2)) * 100.0 * ratio
    return (
        log(WRONG_UNIT_PROB / (2.0 * (high - low)))
        - log(by_effect)
        - calc_log_prior_odds("steady", names)
    )


def calc_row_log_odds(
    late_s: float, row_s: float, sd_s: float, usual_s: float, names: int
) -> float:
    """Return the log odds that a drive is `late_s` because its log is shifted by a row of `row_s`,
    against a delay effect.

    sd_s : s.d. of the delay. The delay effect is one of `names`, steady, with a Cauchy prior for
    its size.
    """
    by_row = exp(-0.5 * ((late_s - row_s) / sd_s) ** 2) / (sqrt(2.0 * pi) * sd_s)
    by_effect = 2.0 * usual_s / (pi * (usual_s**2 + late_s**2))
    return log(WRONG_ROW_PROB * max(by_row, 1e-300) / by_effect) - calc_log_prior_odds(
        "steady", names
    )


def calc_form_log_odds(
    quantities: int, variables: int, places: int, temporary: bool = False
) -> float:
    """Return the log prior odds of one form of one term, among the given numbers of quantities,
    variables (or pairs) and positions.

    temporary : whether the term comes and goes, over no variable but time.
    """
    if temporary:
        return log(UNKNOWN_PROB * COURSE_PROBS["ends"] / (max(1, quantities) * places))
    return log(UNKNOWN_PROB / (max(1, quantities) * max(1, variables) * len(Form) * max(1, places)))


def calc_detectable_size(usual: float, information: float, log_odds: float) -> float:
    """Return the size of an effect that would be reported nine times in ten, for data with
    `information` (inverse variance) on the size.

    Its log odds against no effect then reach MIN_REPORT_LOG_ODDS. The result is inf where the data
    have no information.
    """
    if information <= 0.0:
        return inf
    needed = MIN_REPORT_LOG_ODDS - log_odds + 0.5 * log1p(usual**2 * information)
    return (sqrt(2.0 * needed) + ONE_SIDED_90_QUANTILE) / sqrt(information)
