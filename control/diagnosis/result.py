"""The result of a diagnosis, by the published contract "topdress-diagnosis/1"."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from importlib import import_module
from typing import Any, Literal, NamedTuple

FORMAT = "topdress-diagnosis/1"
# a rival that is no effect of the catalogue: something else
UNKNOWN = "unknown"
RUN_CHANNELS = ("shaft", "gate", "flow", "scale", "speed", "heads")
CHANNELS = (*RUN_CHANNELS, "effort", "gate_effort", "lag", "place")

Verdict = Literal["named", "none", "ambiguous", "unexplained", "not_judged"]
# pages and pictures, and the machine files that come with topdress
NOTEBOOK = "topdress.console.reports.notebook"


@dataclass(frozen=True, slots=True)
class SourceSummary:
    path: str
    kind: str  # run, lag, catch, weigh, heads, place
    rows: int
    duration_s: float | None
    machine: str
    stages: tuple[str, ...] = ()  # that the machine has; (): all


@dataclass(frozen=True, slots=True)
class Channel:
    """How well the nominal model predicts one channel."""

    channel: str
    unit: str
    n: int
    bias: float
    rmse: float
    noise_floor: float
    explained_by_nominal: float  # share of the channel's variance
    structure_p: float  # probability that there is nothing but noise


@dataclass(frozen=True, slots=True)
class Size:
    value: float | None
    low: float | None  # 90 % interval
    high: float | None
    unit: str


@dataclass(frozen=True, slots=True)
class Rival:
    """`id`: of an effect, or UNKNOWN."""

    id: str
    probability: float


@dataclass(frozen=True, slots=True)
class FieldCost:
    """What an effect does in the field when nobody knows of it. None: that depends on what the
    data cannot tell."""

    rate_error_percent: float | None  # applied over wanted less 1
    place_error_m: float | None  # landed less wanted, late positive


@dataclass(frozen=True, slots=True)
class Cause:
    id: str
    size: Size
    onset_s: float | None
    probability: float
    rivals: tuple[Rival, ...]  # the members of the 95 % confidence set
    member: int | None
    advice: str
    field_cost: FieldCost
    # the label or table that it holds for; None: all the data
    scope: str | None = None
    until_s: float | None = None  # when it ended; None: not in this data
    # from nothing at its onset to its size at the end of the data
    grows: bool = False


@dataclass(frozen=True, slots=True)
class Detectable:
    value: float | None  # None: this data cannot show it at all
    unit: str


@dataclass(frozen=True, slots=True)
class NotShown:
    id: str
    smallest_detectable: Detectable


@dataclass(frozen=True, slots=True)
class Unexplained:
    """`variable`: the recorded variable that the structure follows, "" where none is known to
    carry it.

    `explained_share`: of what the named causes leave, that the variable explains; without a
    variable, that is not noise. `rms`, `noise`: of the channel, in its unit. `dose_percent`:
    r.m.s. in the dose, where that is known. `hint`: the effect that comes nearest, though its
    evidence does not hold. `from_s`: when it seems to begin. `period_s`: where it comes and
    goes at one frequency.
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
    """What would tell rivals apart. `id`, `minutes` and `steps` are for programs. Where no run
    of the program's list tells them apart, these are empty and `plan` is the effect's own
    experiment. `tests`: the bench tests of a plan one by one, for people, each with its
    minutes; (): `plan` is one thing to do."""

    why: str
    plan: str
    id: str = ""
    minutes: float | None = None
    steps: tuple[str, ...] = ()
    tests: tuple[str, ...] = ()

    def to_do(self) -> tuple[str, ...]:
        """What a person does, one thing after the other."""
        return self.tests or (self.plan,)


@dataclass(frozen=True, slots=True)
class Gain:
    channel: str
    metric: str
    before: float
    after: float
    low: float
    high: float
    held_out: str
    # what is put in: the causes, or something to compare
    of: Literal["names", "corrector", "placebo"] = "names"


@dataclass(frozen=True, slots=True)
class UnexplainedCurve:
    """The smooth extension where no effect explains what is there: straight lines between nodes
    of one variable."""

    stage: str
    variable: str
    nodes: tuple[float, float, float, float, float, float, float, float]
    # in the unit of the stage's table
    values: tuple[float, float, float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class TermFound:
    """A term that the data show beyond the catalogue (docs/terms.md).

    `term`: as the machine file takes it. `explained_share`: of what the named causes leave, as
    variance. `dose_percent`: r.m.s. in the dose; 0 where it moves none. `gain`: of twice the
    log-likelihood. `seen`: its first variable's values (nodes), what the data say there and
    what the term says, in the unit of `acts_on`.
    """

    term: dict[str, Any]
    stage: str
    unit: str
    explained_share: float
    dose_percent: float
    gain: float
    held_out_gain: float | None
    seen: tuple[tuple[float, float, float], ...] = ()
    # a part of what predicts best (`Predicted.rival`): no cause is named by it
    predicts_best: bool = False
    # why no machine file takes it up, where prediction says so
    refused: str = ""


@dataclass(frozen=True, slots=True)
class Predicted:
    """R.m.s. errors of one channel on the whole log, each from its own start, in `unit`: of the
    machine file as it was, of the file with what it takes up, of all that is said (None: not
    asked for), and of the plain rival: curve of the command, lag, dead time and straight lines
    `over` recorded variables, by least squares (None: not needed)."""

    channel: str
    unit: str
    before: float
    file: float
    said: float | None = None
    rival: float | None = None
    over: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class UnattributedDriveFit:
    """A drive fitted as a whole, where what is wrong with it was not told apart: sizes by
    effect that predict best together, each no cause. `before`, `after`: r.m.s. error on rows
    that were not fitted to."""

    channel: str
    sizes: tuple[tuple[str, Size], ...]
    before: float
    after: float
    unit: str


@dataclass(frozen=True, slots=True)
class RateFit:
    """Applied against target, of data that hold rates and no drives: the applied rate is `gain`
    times the target `lag` before. `number`: of the pass, from 1; None: all of them. `place_m`:
    the lag at the pass's speed. `differ`: the passes' gains differ by more than their noise,
    and the interval holds that."""

    number: int | None
    passes: int
    begin_s: float
    end_s: float
    rows: int
    # s, late positive; None: the target changes too little
    lag: Size
    gain: Size  # applied over target
    place_m: float | None
    differ: bool = False


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Precedence of verdicts: unexplained, ambiguous, named, none; not_judged where no channel
    could be judged: there are none, or the data tell nothing of them that was not believed
    before.

    Fields that do not apply are None, not left out.
    """

    data: SourceSummary
    channels: tuple[Channel, ...]
    verdict: Verdict
    causes: tuple[Cause, ...]  # largest consequence first
    not_shown: tuple[NotShown, ...]
    unexplained: tuple[Unexplained, ...]
    next_run: NextRun | None
    gain: tuple[Gain, ...]
    extended_machine: str | None
    findings: tuple[str, ...] = ()  # plain sentences about the data itself
    # smooth extensions, one for each entry of unexplained
    tables: tuple[UnexplainedCurve, ...] = ()
    # recorded variable -> range of the data
    excited: dict[str, tuple[float, float]] = field(default_factory=dict)
    # what no effect explains, as terms of the machine file
    terms: tuple[TermFound, ...] = ()
    # where no channel could be judged and both rates are there; all passes first
    rates: tuple[RateFit, ...] = ()

    # where the shaft's model leaves more than noise: what predicts best
    fitted: UnattributedDriveFit | None = None
    # what the machine file predicts, and what it was held against
    predicted: tuple[Predicted, ...] = ()

    # log, machine
    seen_with: tuple[Any, Any] | None = field(default=None, compare=False, repr=False)
    # The library of the data frame that the log came in; empty: it came in none.
    frame_library: str = field(default="", compare=False, repr=False)

    def __str__(self) -> str:
        return self.summary()

    def summary(self) -> str:
        """Verdict, causes, rival and gain in at most 15 lines."""
        return str(load_notebook_room().summarise_diagnosis(self))

    def to_frame(self) -> Any:
        """The named causes as a data frame, a row each, of the library that the log came in
        (pandas where it came in none).

        Columns: id, size, low, high (90 %), unit, probability, onset_s, rate_percent, advice.
        Raises ValueError, one line, where the library is not installed.
        """
        return load_notebook_room().make_causes_frame(self)

    def residuals(self) -> Any:
        """What was measured and predicted, as a data frame of the library that the log came in.

        Columns: channel, unit, time_s, measured, nominal (as the machine file predicts),
        predicted (with the named causes), residual (measured less predicted). Raises ValueError,
        one line, where the log is not known or the library is not installed.
        """
        return load_notebook_room().make_residuals_frame(self)

    def to_json(self) -> dict[str, Any]:
        plain = asdict(replace(self, seen_with=None))
        del plain["seen_with"], plain["frame_library"]
        return {"format": FORMAT, **plain}

    def plot(self) -> Any:
        """Its pictures, for a notebook: `found.plot()` shows them,
        `found.plot().save("why.html")` keeps them. `found.plot()[0]` is a `ChartSheet`: its
        panels' titles, labels and colours may be changed before it is shown.

        Raises ValueError, one line, where the log is not known.
        """
        return load_notebook_room().draw_diagnosis(self)

    def _repr_html_(self) -> str:
        """What a notebook shows below a cell that ends with a diagnosis."""
        return str(load_notebook_room().format_notebook_html(self))


class Departure(NamedTuple):
    """What a live check says: how the machine departs from its model.

    `cause`: id of an effect, "" where it has no name. `percent`: by how much the dose is wrong,
    None where that is not known or nothing. `since_s`: of the log; None: since it began, or
    before the stretch that was looked at. `certain`: no other effect would do as well.
    `find_separating_run`: what would tell the rivals apart (`NextRun.plan`).
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


def load_notebook_room() -> Any:
    """The room that draws, asked for by name when it is wanted: control knows nothing of it.
    Raises ValueError, one line, where only `control` is installed."""
    try:
        return import_module(NOTEBOOK)
    except ImportError as error:
        raise ValueError(
            f"pictures and shipped machines come with the whole of topdress: {error}"
        ) from None
