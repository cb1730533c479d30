"""Selects the causes and terms of a diagnosis that a machine file may adopt: those with which the
file predicts the log better (`prediction.validate_prediction`).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from topdress.control.diagnosis.effects import EFFECT_ROWS, FoundBy
from topdress.control.diagnosis.extend import extend, find_cause_refusal
from topdress.control.diagnosis.prediction.log_prediction import LogPredictor
from topdress.control.diagnosis.prediction.predictive_validation import (
    NO_GAIN_TEXT,
    AdoptablePart,
    select_predictive_causes,
)
from topdress.control.diagnosis.result import Cause, Diagnosis
from topdress.control.machine.machine import CATALOGUE

from .compared import compared
from .diagnose import prepare_log


def select_adoptable(found: Diagnosis, chosen: Collection[str]) -> AdoptablePart:
    """Return the chosen causes and the terms of a run log's diagnosis with which a machine file
    predicts better.

    Bench tables are returned unchanged, because their sizes are averaged over all models already.

    Parameters
    ----------
    found
        The diagnosis, with its terms.
    chosen
        Ids of the causes that the user chose.

    Returns
    -------
    Adoptable
        The diagnosis with the adoptable causes, and each refused name with its reason.
    """
    kept = tuple(
        cause for cause in found.causes if cause.id in chosen and not find_cause_refusal(cause)
    )
    if found.seen_with is None or found.data.kind != "run":
        return AdoptablePart(replace(found, causes=kept), ())
    columns, machine = found.seen_with
    log, data, read_off = prepare_log(columns, machine)
    with np.errstate(all="ignore"):
        taken = select_predictive_causes(
            LogPredictor(log, data, machine), found, chosen, {one.part.id for one in read_off}
        )
    worse = [one.id for one in taken.found.causes if not predicts_no_worse(found, one)]
    return taken._replace(
        found=replace(
            taken.found, causes=tuple(one for one in taken.found.causes if one.id not in worse)
        ),
        refused=(*taken.refused, *((name, NO_GAIN_TEXT) for name in worse)),
    )


def predicts_no_worse(found: Diagnosis, cause: Cause) -> bool:
    """Tell whether a cause found before the search predicts its rows no worse than without the
    cause.

    Only encoder steps can fail here. Steps in a prediction help where the prediction is within a
    step of the true speed, and add their own rounding error where the prediction is not.
    """
    if EFFECT_ROWS[cause.id].found_by is not FoundBy.STEPS or found.seen_with is None:
        return True
    columns, machine = found.seen_with
    seen = compared(
        columns, machine, extend(machine, replace(found, causes=(cause,), terms=(), fitted=None))
    )
    return all(
        one.new <= one.old for one in seen.channels if one.channel == CATALOGUE[cause.id].stage
    )
