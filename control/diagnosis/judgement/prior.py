"""What is believed before the data are seen: every number that a judgement rests on, with its
reason.

A group of channels (shaft; metering; speed; heads) has something wrong with `FAULTY`. Which
effect it is has the same odds for each of the group, and how it runs in time the shares of
`COURSE`. How large it is: about 0, of the order of `usual` of the effect's row
(control/diagnosis/effects.py), with the tails of a Cauchy distribution: what a machine has may
be ten times the usual. Such a prior is a normal of unknown s.d. (Andrews and Mallows, JRSS B
36, 1974, 99); here the s.d. is the one that fits best, not below `usual`, and what it is
likelier to be smaller is paid for. When it begins or ends: any time of the log alike.
"""

from __future__ import annotations

from math import exp, inf, log, log1p, pi, sqrt

from topdress.control.machine.forms import Form
from topdress.control.machine.terms import TermTarget

# Prior probability that a group of stages has a fault on a machine that is diagnosed.
FAULTY = 0.3
# of what is wrong, how it runs: most was there before the log began
COURSE = {"steady": 0.7, "begins": 0.15, "grows": 0.075, "ends": 0.075}
# a column is in another unit than its file says, or of the other side of a gear ...
MISTAKEN_UNIT = 0.03
# ... by a factor between these (gears 2 up, turns a second 60), either way
UNIT_FACTORS = log(2.0), log(1000.0)
# a log writes what was read a row late, or a command a row early, and nothing else tells
MISTAKEN_ROW = 0.03
# what is lost, or comes late, is less than the machine file has of it: one in fifty
WRONG_SIGN = 0.02
# ... or something that no effect describes, shared over quantities, variables and forms
UNKNOWN = 0.03
# an effect holds in one label or table only, though others could show it: one in ten
LOCAL = 0.1
# ... or a bench table has one setting that was set or written down wrongly
MISTAKEN = 0.03
# one row of a bench table was misread: one table in ten
MISREAD = 0.1
# s.d. of a term's coefficients over the spread of its variable, in its quantity's unit
USUAL_OF_TERM = {
    TermTarget.SHAFT_PERCENT: 3.0,
    TermTarget.SHAFT_RPM: 3.0,
    TermTarget.GATE_MM: 1.5,
    TermTarget.FLOW_PERCENT: 6.0,
    TermTarget.SCALE_KG: 1.0,
    TermTarget.WHEEL_PERCENT: 3.0,
}
# of an effect's own signal, by which its form may differ from the catalogue's
FORM_SHARE = 0.25
# posterior probability from which on a cause is named
NAMED = 0.9
# log odds against nothing, from which on something is said to be there
SAID = log(NAMED / (1.0 - NAMED))
ROBUST_SD = 1.4826  # of a normal, over its median absolute deviation
# of a normal: nine in ten are above its mean less so many s.d.
NINE_IN_TEN_SD = 1.2816
# of two hypotheses: nine measurements in ten then tell them apart
APART_SD = sqrt(2.0 * SAID) + NINE_IN_TEN_SD
LISTED = 0.02  # ... and from which on a rival is listed


def name_course(onset_s: float | None, until_s: float | None, grows: bool) -> str:
    """The word of COURSE."""
    if onset_s is None:
        return "steady"
    return "grows" if grows else "begins" if until_s is None else "ends"


def calc_log_prior_odds(course: str, names: int) -> float:
    """Log prior odds of one effect of `names`, on top of whatever else is wrong."""
    return log(FAULTY * COURSE[course] / max(1, names))


def calc_log_of_sign(size: float, only_adds: bool) -> float:
    """What the sign of a size adds to a prior that is even about 0: of an effect that only
    adds, one sign is rare."""
    if not only_adds or size == 0.0:
        return 0.0
    return log(2.0 * (WRONG_SIGN if size < 0.0 else 1.0 - WRONG_SIGN))


def find_size_sd(size: float, usual: float) -> float:
    """s.d. of the normal that the prior of a size is near that size."""
    return max(usual, abs(size))


def find_size_log_weight(size: float, usual: float) -> float:
    """Logarithm of the weight of that normal."""
    return log(usual / find_size_sd(size, usual))


def log_odds_of_unit(ratio: float, usual: float, names: int) -> float:
    """Log odds that a reading is `ratio` times what its command asks because one of them is in
    another unit, against an effect of `names` that makes it so much larger or smaller,
    steadily, its size with the tails of a Cauchy distribution of scale `usual` (both of %)."""
    low, high = UNIT_FACTORS
    if not low < abs(log(ratio)) < high:
        return -inf
    percent = 100.0 * (ratio - 1.0)
    # per unit of the ratio's logarithm
    by_effect = usual / (pi * (usual**2 + percent**2)) * 100.0 * ratio
    return (
        log(MISTAKEN_UNIT / (2.0 * (high - low)))
        - log(by_effect)
        - calc_log_prior_odds("steady", names)
    )


def log_odds_of_row(late_s: float, row_s: float, sd_s: float, usual_s: float, names: int) -> float:
    """Log odds that a drive is `late_s` because its log's rows are one off, of `row_s`, known
    so well (1 s.d.), against an effect of `names` that delays it, steadily, its size with the
    tails of a Cauchy distribution."""
    by_row = exp(-0.5 * ((late_s - row_s) / sd_s) ** 2) / (sqrt(2.0 * pi) * sd_s)
    by_effect = 2.0 * usual_s / (pi * (usual_s**2 + late_s**2))
    return log(MISTAKEN_ROW * max(by_row, 1e-300) / by_effect) - calc_log_prior_odds(
        "steady", names
    )


def log_odds_of_form(
    quantities: int, variables: int, places: int, temporary: bool = False
) -> float:
    """Log prior odds of one form of one term: of so many quantities and variables (or pairs of
    them), at one of so many places. temporary : it comes and goes, over no variable but time."""
    if temporary:
        return log(UNKNOWN * COURSE["ends"] / (max(1, quantities) * places))
    return log(UNKNOWN / (max(1, quantities) * max(1, variables) * len(Form) * max(1, places)))


def smallest_said(usual: float, information: float, log_odds: float) -> float:
    """Size of an effect that would be said nine times in ten, where the data have so much
    `information` on it (1 over its variance): its log odds against nothing then reach SAID.
    inf: they have none."""
    if information <= 0.0:
        return inf
    needed = SAID - log_odds + 0.5 * log1p(usual**2 * information)
    return (sqrt(2.0 * needed) + NINE_IN_TEN_SD) / sqrt(information)
