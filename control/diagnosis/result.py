"""Defines the result of a diagnosis, by the published contract "topdress-diagnosis/1"."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from importlib import import_module
from typing import Any, Literal, NamedTuple

FORMAT = "topdress-diagnosis/1"
# Id of a rival that is no effect of the catalogue: an unknown cause.
UNKNOWN = "unknown"
RUN_CHANNELS = ("shaft", "gate", "flow", "scale", "speed", "heads")
CHANNELS = (*RUN_CHANNELS, "effort", "gate_effort", "lag", "place")

Verdict = Literal["named", "none", "ambiguous", "unexplained", "not_judged"]
# Module that draws pages and pictures, and loads the machine files that come with topdress.
NOTEBOOK_MODULE = "topdress.console.reports.notebook"


@dataclass(frozen=True, slots=True)
class SourceSummary:
    """Source of the data of a diagnosis."""

    path: str
    # Kind of data: run, lag, catch, weigh, heads, or place.
    kind: str
    rows: int
    duration_s: float | None
    machine: str
    # Stages that the machine has; empty for all stages.
    stages: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Channel:
    """Accuracy of the nominal model for one channel."""

    channel: str
    unit: str
    n: int
    bias: float
    rmse: float
    noise_floor: float
    # Explained share of the channel's variance.
    explained_by_nominal: float
    # P value of the residual under pure noise.
    structure_p: float


@dataclass(frozen=True, slots=True)
class Size:
    """A size with its 90 % interval; None means that the data do not determine the number."""

    value: float | None
    # Lower end of the 90 % interval.
    low: float | None
    high: float | None
    unit: str


@dataclass(frozen=True, slots=True)
class Rival:
    """An alternative cause. `id`: of an effect, or UNKNOWN."""

    id: str
    probability: float


@dataclass(frozen=True, slots=True)
class FieldCost:
    """Cost of an uncompensated effect in the field. None means that the cost depends on facts that
    are not in the data."""

    # Applied over target rate minus 1, %.
    rate_error_percent: float | None
    # Landing position minus target position, m; late is positive.
    place_error_m: float | None


@dataclass(frozen=True, slots=True)
class Cause:
    """A named cause with its size, probability and rivals."""

    id: str
    size: Size
    onset_s: float | None
    probability: float
    # Members of the 95 % confidence set.
    rivals: tuple[Rival, ...]
    member: int | None
    advice: str
    field_cost: FieldCost
    # Label or table for which the cause holds; None for all data.
    scope: str | None = None
    # Time of the end, s; None means that the effect does not end in this data.
    until_s: float | None = None
    # Whether the effect grows from zero at its onset to its size at the end of the data.
    grows: bool = False


@dataclass(frozen=True, slots=True)
class DetectableSize:
    """Smallest detectable size of an effect."""

    # None means that this data cannot show the effect at any size.
    value: float | None
    unit: str


@dataclass(frozen=True, slots=True)
class UnnamedEffect:
    """An effect that was not named, with its smallest detectable size."""

    id: str
    smallest_detectable: DetectableSize


@dataclass(frozen=True, slots=True)
class UnexplainedStructure:
    """Structure in the residual without a name. `variable`: the recorded variable on which the
    structure depends, "" where none is known.

    `explained_share`: share of the residual variance that the variable explains, or, without a
    variable, the share that is not noise. `rms`, `noise`: of the channel, in its unit.
    `dose_percent`: r.m.s. in the dose, where known. `hint`: the most similar effect, though its
    evidence is insufficient. `from_s`: apparent onset. `period_s`: period, where the structure is a
    single frequency.
    """

    channel: str
    variable: str
    explained_share: float
    rms: float | None = None
    noise: float | None = None
    unit: str = ""
    dose_percent: float | None = None
    hint: str = ""
    from_s: float | None = None
    period_s: float | None = None


@dataclass(frozen=True, slots=True)
class NextRun:
    """The test that separates rivals. `id`, `minutes` and `steps` are for programs.

    Where no run of the program's list separates the rivals, these are empty and `plan` is the
    effect's own experiment. `tests`: the bench tests of a plan as text, each with its minutes;
    empty where `plan` is a single task.
    """

    why: str
    plan: str
    id: str = ""
    minutes: float | None = None
    steps: tuple[str, ...] = ()
    tests: tuple[str, ...] = ()

    def to_do(self) -> tuple[str, ...]:
        """Tasks for the user, in order."""
        return self.tests or (self.plan,)


@dataclass(frozen=True, slots=True)
class Gain:
    """Error of a channel before and after a correction, on held-out data."""

    channel: str
    metric: str
    before: float
    after: float
    low: float
    high: float
    held_out: str
    # The correction: the named causes, or a substitute for comparison.
    of: Literal["names", "corrector", "placebo"] = "names"


@dataclass(frozen=True, slots=True)
class UnexplainedCurve:
    """The smooth extension where no effect explains the structure: linear interpolation between
    nodes of one variable."""

    stage: str
    variable: str
    nodes: tuple[float, float, float, float, float, float, float, float]
    # Values at the nodes, in the unit of the stage's table.
    values: tuple[float, float, float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class TermFound:
    """A term that the data show beyond the catalogue (docs/terms.md).

    `term`: in the form of the machine file. `explained_share`: share of the residual variance after
    the named causes. `dose_percent`: r.m.s. in the dose; 0 where the dose does not change. `gain`:
    in twice the log-likelihood. `seen`: values of the first variable (nodes), means of the data,
    and the term, in the unit of `acts_on`.
    """

    term: dict[str, Any]
    stage: str
    unit: str
    explained_share: float
    dose_percent: float
    gain: float
    held_out_gain: float | None
    seen: tuple[tuple[float, float, float], ...] = ()
    # Whether the term is part of the best prediction (`PredictionErrors.rival`) only, and names no
    # cause.
    predicts_best: bool = False
    # Reason why no machine file adopts the term, where prediction refuses it.
    refused: str = ""


@dataclass(frozen=True, slots=True)
class PredictionErrors:
    """R.m.s. errors of one channel on the whole log, in `unit`, each prediction from its own start.

    `before`: the machine file unchanged. `file`: the file with the adopted results. `said`: all
    reported results (None where not calculated). `rival`: the plain rival by least squares, with a
    curve of the command, lag, dead time and straight lines `over` recorded variables (None where
    not needed).
    """

    channel: str
    unit: str
    before: float
    file: float
    said: float | None = None
    rival: float | None = None
    over: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class UnattributedDriveFit:
    """A drive fitted as a whole, where its errors could not be separated: sizes by effect that
    predict best together, none of which is a cause. `before`, `after`: r.m.s. error on held-out
    rows."""

    channel: str
    sizes: tuple[tuple[str, Size], ...]
    before: float
    after: float
    unit: str


@dataclass(frozen=True, slots=True)
class AppliedVersusTarget:
    """Applied against target rate, of data that contain rates and no drives: the applied rate is
    `gain` times the target `lag` before.

    `number`: of the pass, from 1; None for all passes together. `place_m`: the lag times the pass's
    speed. `differ`: whether the passes' gains differ by more than their noise; the interval then
    includes the difference.
    """

    number: int | None
    passes: int
    begin_s: float
    end_s: float
    rows: int
    # Lag in s, late positive; None where the target changes too little.
    lag: Size
    # Applied over target rate.
    gain: Size
    place_m: float | None
    differ: bool = False


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Result of a diagnosis. Precedence of verdicts: unexplained, ambiguous, named, none.

    The verdict is not_judged where no channel could be judged: the data have no channel, or contain
    no more information about the channels than the prior. Fields that do not apply are None, not
    left out.
    """

    data: SourceSummary
    channels: tuple[Channel, ...]
    verdict: Verdict
    # Largest consequence first.
    causes: tuple[Cause, ...]
    not_shown: tuple[UnnamedEffect, ...]
    unexplained: tuple[UnexplainedStructure, ...]
    next_run: NextRun | None
    gain: tuple[Gain, ...]
    extended_machine: str | None
    # Plain sentences about the data.
    findings: tuple[str, ...] = ()
    # Smooth extensions, one for each entry of unexplained.
    tables: tuple[UnexplainedCurve, ...] = ()
    # Range of each recorded variable in the data.
    excited: dict[str, tuple[float, float]] = field(default_factory=dict)
    # Structure that no effect explains, as terms of the machine file.
    terms: tuple[TermFound, ...] = ()
    # Fits of the rates where no channel could be judged and both rates exist; all passes first.
    rates: tuple[AppliedVersusTarget, ...] = ()

    # The best-predicting fit where the shaft's model leaves more than noise.
    fitted: UnattributedDriveFit | None = None
    # Errors of the machine file's prediction, and of the predictions for comparison.
    predicted: tuple[PredictionErrors, ...] = ()

    # The log and the machine of the diagnosis.
    seen_with: tuple[Any, Any] | None = field(default=None, compare=False, repr=False)
    # Library of the log's data frame; empty for other data.
    frame_library: str = field(default="", compare=False, repr=False)

    def __str__(self) -> str:
        return self.summary()

    def summary(self) -> str:
        """Return verdict, causes, rival and gain in at most 15 lines."""
        return str(load_notebook_module().summarise_diagnosis(self))

    def to_frame(self) -> Any:
        """Return the named causes as a data frame, a row each, of the log's library (pandas for
        other data).

        Columns: id, size, low, high (90 %), unit, probability, onset_s, rate_percent, advice.
        Raises ValueError, one line, where the library is not installed.
        """
        return load_notebook_module().make_causes_frame(self)

    def residuals(self) -> Any:
        """Return measured and predicted values as a data frame of the log's library.

        Columns: channel, unit, time_s, measured, nominal (prediction of the machine file),
        predicted (with the named causes), residual (measured minus predicted). Raises ValueError,
        one line, where the log is not available or the library is not installed.
        """
        return load_notebook_module().make_residuals_frame(self)

    def to_json(self) -> dict[str, Any]:
        """Return the diagnosis as JSON-compatible data, by the published contract."""
        plain = asdict(replace(self, seen_with=None))
        del plain["seen_with"], plain["frame_library"]
        return {"format": FORMAT, **plain}

    def plot(self) -> Any:
        """Draw the pictures of the diagnosis for a notebook.

        `found.plot()` shows the pictures, `found.plot().save("why.html")` stores them.
        `found.plot()[0]` is a `ChartSheet`: titles, labels and colours of its panels may be changed
        before it is shown.

        Raises ValueError, one line, where the log is not available.
        """
        return load_notebook_module().draw_diagnosis(self)

    def _repr_html_(self) -> str:
        """Return the HTML that a notebook shows below a cell that ends with a diagnosis."""
        return str(load_notebook_module().format_notebook_html(self))


class ModelDeviation(NamedTuple):
    """A deviation of the machine from its model, reported by a live check.

    `cause`: id of an effect, "" where unknown. `percent`: error of the dose, None where unknown or
    zero. `since_s`: time in the log; None means that the deviation began with the log, or before
    the examined part. `certain`: whether no other effect is as likely. `find_separating_run`: the
    test that separates the rivals (`NextRun.plan`).
    """

    channel: str
    cause: str
    percent: float | None
    since_s: float | None
    certain: bool = True
    adoptable: bool = False
    next_run: str = ""
    size: float | None = None
    unit: str = ""


def load_notebook_module() -> Any:
    """Import the drawing module by name when it is first needed, because control does not depend on
    it.

    Raises ValueError, one line, where only `control` is installed.
    """
    try:
        return import_module(NOTEBOOK_MODULE)
    except ImportError as error:
        raise ValueError(
            f"pictures and shipped machines come with the whole of topdress: {error}"
        ) from None
