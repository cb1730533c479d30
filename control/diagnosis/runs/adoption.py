"""What of a diagnosis a machine file may take up: as much as predicts its log better
(`prediction.validate_prediction`)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from topdress.control.diagnosis.effects import ROWS, FoundBy
from topdress.control.diagnosis.extend import extend, not_adoptable
from topdress.control.diagnosis.prediction.on_log import OnLog
from topdress.control.diagnosis.prediction.predictive_validation import (
    WORSE,
    Adoptable,
    select_predictive_causes,
)
from topdress.control.diagnosis.result import Cause, Diagnosis
from topdress.control.machine.machine import CATALOGUE

from .compared import compared
from .diagnose import series_of_log


def select_adoptable(found: Diagnosis, chosen: Collection[str]) -> Adoptable:
    """The chosen causes (by id) of a run log's diagnosis with its terms, as far as a file with
    them predicts better.

    Bench tables are returned as they are: their sizes are weighed over all models already.
    """
    kept = tuple(cause for cause in found.causes if cause.id in chosen and not not_adoptable(cause))
    if found.seen_with is None or found.data.kind != "run":
        return Adoptable(replace(found, causes=kept), ())
    columns, machine = found.seen_with
    log, data, read_off = series_of_log(columns, machine)
    with np.errstate(all="ignore"):
        taken = select_predictive_causes(
            OnLog(log, data, machine), found, chosen, {one.part.id for one in read_off}
        )
    worse = [one.id for one in taken.found.causes if not _reads_better(found, one)]
    return taken._replace(
        found=replace(
            taken.found, causes=tuple(one for one in taken.found.causes if one.id not in worse)
        ),
        refused=(*taken.refused, *((name, WORSE) for name in worse)),
    )


def _reads_better(found: Diagnosis, cause: Cause) -> bool:
    """Of what was read off the log before the search: whether its rows are predicted no worse
    with it. Steps of an encoder in a prediction help where it is within a step, and add their
    own rounding where it is not."""
    if ROWS[cause.id].found_by is not FoundBy.STEPS or found.seen_with is None:
        return True
    columns, machine = found.seen_with
    seen = compared(
        columns, machine, extend(machine, replace(found, causes=(cause,), terms=(), fitted=None))
    )
    return all(
        one.new <= one.old for one in seen.channels if one.channel == CATALOGUE[cause.id].stage
    )
