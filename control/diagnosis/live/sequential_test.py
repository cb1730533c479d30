"""Sequential test for effects that started within the last minutes; each test predicts only the new
rows.

Each test tries every effect of the catalogue with every onset in the window, on the residual
whitened by its fitted noise, with the drift of the hour before (`runs/changepoint.py`). The
statistic is that of Shiryaev and Roberts: likelihood ratios summed over all onsets, with sizes and
effects integrated over their priors. Without a change its mean grows by one with each sample, so
the mean time until it exceeds A is at least A samples (Pollak, Annals of Statistics 15, 1987, 749);
a finite window has a negligible effect (Lai, IEEE Transactions on Information Theory 44, 1998,
2917). The threshold is therefore the mean time between false alarms.

A piece is the newest rows with some rows before, in which the stages settle: the memory of a drive
or a tube ends within seconds. Its residuals and the trace of each effect are averaged in bins of a
second, at which every effect that is linear in its size still shows completely, and are appended to
those of the pieces before. A scale accumulates, so its pieces are stored as changes from bin to
bin. Dead times, bands and backlash are nonlinear in their sizes and are confounded in such a short
stretch, so they wait for a full diagnosis.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from math import log
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.effects import EFFECT_ROWS, FoundBy
from topdress.control.diagnosis.judgement.evidence import (
    Column,
    ColumnRole,
    choose_better_fit,
    make_evidence_problem,
)
from topdress.control.diagnosis.judgement.noise import (
    Noise,
    NoisePrior,
    calc_coefficients,
    find_starting_noise,
    make_segments,
    make_series,
)
from topdress.control.diagnosis.judgement.prior import COURSE_PROBS, name_course
from topdress.control.diagnosis.runs.changepoint import find_best_onsets, select_onset_candidates
from topdress.control.diagnosis.runs.channels import ChannelSeries, make_channels
from topdress.control.diagnosis.runs.columns import list_nuisance_columns
from topdress.control.diagnosis.runs.diagnose import prepare_log
from topdress.control.diagnosis.runs.grid import Grid
from topdress.control.diagnosis.runs.hypothesis import EffectInstance
from topdress.control.diagnosis.runs.log import HEAD_COLUMNS, MIN_ROWS, CleanLog, clean_run_log
from topdress.control.diagnosis.runs.model import CHANNEL_GROUPS, GroupModel, is_cumulative
from topdress.control.diagnosis.runs.row_order import ColumnShift, find_row_order, shift_log_columns
from topdress.control.diagnosis.runs.search import Candidate, list_candidates
from topdress.control.machine.machine import Machine

Array = npt.NDArray[np.float64]
# Returns the columns of a run log since a time, s.
RowReader = Callable[[float], Mapping[str, npt.NDArray[Any]]]

# Window in which an effect may begin, s: a scale takes minutes to show a flow.
WINDOW_S = 600.0
# Bin length, s.
BIN_S = 1.0
# Time before its new rows at which a piece begins, s: the slowest drive settles within it.
SETTLE_S = 15.0
# Minimum number of rows before the new rows of a piece.
SETTLE_ROWS = 2 * MIN_ROWS
# Time at the end of the rows that is left for the next piece, s: smoothing lacks the rows that
# follow.
DEFERRED_S = 2.0
# Minimum number of bins for a test.
MIN_BINS = 60
# Mean working time between false alarms of the test alone on a healthy machine, s: ten times the
# promised time, because no noise agrees exactly with its model.
FALSE_ALARM_TIME_S = 1000 * 3600.0
# Threshold of the logarithm of the statistic, for a sample in each bin and any group.
ALARM_THRESHOLD = log(FALSE_ALARM_TIME_S / BIN_S * len(CHANNEL_GROUPS))
# Gain in twice the log-likelihood from which onset times are refined: half of the alarm threshold.
MIN_REFINED_GAIN = ALARM_THRESHOLD
# Minimum time since an onset, s: a late answer or a stop ends sooner.
MIN_ONSET_AGE_S = 20.0
# Time range before now, s, of the tests that determine the drift: an effect that begins now is in
# none of them.
DRIFT_WINDOW_S = (300.0, 3900.0)
# A refill that began less than this before the end of a piece, s, may be incomplete.
MIN_REFILL_AGE_S = 10.0

# Role or effect, name, member or index.
LineKey = tuple[str, str, int | None]


class BinnedChannel(NamedTuple):
    """One channel of one piece or of all pieces, in bins. Accumulating lines (`sums`) are stored as
    changes from bin to bin."""

    like: ChannelSeries
    # Middle of each bin, in log time, s: (m,).
    at_s: Array
    # Measured values, (copies, m).
    measured: Array
    # Prediction, columns, traces: (copies, m).
    lines: dict[LineKey, Array]
    sums: frozenset[LineKey]
    # Columns with their priors.
    columns: dict[LineKey, Column]
    candidates: dict[LineKey, Candidate]


PREDICTED_KEY: LineKey = ("predicted", "", None)


class ChangePoint(NamedTuple):
    """The most likely onset in one group of channels."""

    group: str
    # The effect with its onset in log time, s.
    part: EffectInstance
    # Logarithm of the Shiryaev-Roberts statistic for any onset.
    evidence: float


class SequentialTest:
    """Sequential test over the last minutes of a growing log, by group of channels."""

    def __init__(self, machine: Machine, window_s: float = WINDOW_S) -> None:
        self._machine, self._window_s = machine, window_s
        self._kept: dict[str, dict[str, BinnedChannel]] = {}
        # Rows before this time are stored already.
        self._until_s = -np.inf
        self._move: ColumnShift | None = None
        # Whether the next piece is the whole window.
        self._whole = True
        self._tried = list_live_candidates(machine)
        # Noise fitted at each test, by channel, with the time of the test.
        self._noises: dict[str, list[tuple[float, Noise]]] = {}

    def __call__(self, rows: RowReader, now_s: float) -> list[ChangePoint]:
        """Return the most likely onset within the last minutes for each group of channels that the
        rows can show.

        rows : returns columns of a run log since a time. Raises ValueError in one line where
        nothing can be judged.
        """
        self._take_rows(rows, now_s)
        return [
            found for group in self._kept if (found := self._find_best_beginning(group)) is not None
        ]

    def _take_rows(self, rows: RowReader, now_s: float) -> None:
        """Read and store the rows until now."""
        until_s = float(np.floor(now_s - DEFERRED_S))
        if self._whole or self._until_s < now_s - self._window_s:
            from_s = now_s - self._window_s
            piece = rows(from_s)
            self._kept = {}
            self._move = find_row_order(clean_run_log(piece), self._machine)
            self._until_s = -np.inf
        else:
            from_s = self._until_s - SETTLE_S
            piece = rows(from_s)
            if len(piece["time_s"]) < SETTLE_ROWS:
                piece = rows(
                    now_s - (now_s - from_s) * SETTLE_ROWS / max(1, len(piece["time_s"])) - SETTLE_S
                )
        if until_s <= self._until_s:
            return
        self._whole = self._append_bins(
            _bin_piece(piece, self._machine, self._move, self._tried, self._until_s, until_s)
        )
        self._until_s = until_s

    def _append_bins(self, piece: _NewBins) -> bool:
        """Append bins to those stored, and tell whether the next piece must start anew."""
        if piece.broken and self._kept:
            self._kept = {}
            return True
        for group, new in piece.groups.items():
            before = self._kept.get(group, {})
            self._kept[group] = before | {
                name: _join_lines(before.get(name), one) for name, one in new.items()
            }
        return piece.unfinished

    def _find_best_beginning(self, group: str) -> ChangePoint | None:
        """Return the most likely onset among the effects of a group; None where too few bins are
        stored."""
        since_s = self._until_s - self._window_s
        members = [_keep_lines_since(one, since_s) for one in self._kept.get(group, {}).values()]
        members = [one for one in members if len(one.at_s) >= MIN_BINS]
        if not members:
            return None
        series = [_make_channel_series(one) for one in members]
        banded: dict[str, Array] = {}
        base: list[Column] = []
        tried: dict[LineKey, Candidate] = {}
        traces: dict[LineKey, dict[str, Array]] = {}
        for one, channel in zip(members, series, strict=True):
            for key, candidate in one.candidates.items():
                if key in one.lines:
                    tried[key] = candidate
                    traces.setdefault(key, {})[channel.name] = _join_copies(one, key).ravel()
            open_ = [key for key in one.columns if key in one.lines]
            rows = [
                one.measured - _join_copies(one, PREDICTED_KEY),
                *(_join_copies(one, key) for key in open_),
            ]
            left, *columns = calc_coefficients(np.array(rows).reshape(len(rows), -1), channel.cut)
            banded[channel.name] = left
            base += [
                one.columns[key]._replace(coefficients={channel.name: column})
                for key, column in zip(open_, columns, strict=True)
            ]
        noise = {channel.name: find_starting_noise(channel.prior) for channel in series}
        p = make_evidence_problem(series, banded, base)
        fit = choose_better_fit(p, np.arange(len(base)), noise, series)
        usual = {name: self._find_usual_noise(name, one) for name, one in fit.noise.items()}
        found = find_best_onsets(
            series,
            banded,
            base,
            [usual],
            list(tried.values()),
            [traces[key] for key in tried],
            matters=MIN_REFINED_GAIN,
            end_s=MIN_ONSET_AGE_S,
        )
        if not found:
            return None
        times = sum(len(one.at_s) for one in members)
        odds = [
            one.evidence + log(COURSE_PROBS[name_course(one.part.onset_s, None, one.part.grows)])
            for one in found
        ]
        prior = log(sum(COURSE_PROBS[word] for word in ("begins", "grows")) * len(tried))
        return ChangePoint(
            group, found[0].part, float(np.logaddexp.reduce(odds)) - prior + log(times)
        )

    def _find_usual_noise(self, name: str, now: Noise) -> Noise:
        """Return the noise of a channel with the drift of the last hour, because an effect that
        begins now inflates its own noise.

        Until minutes of the log are stored, the currently fitted noise is returned.
        """
        looks = self._noises.setdefault(name, [])
        looks.append((self._until_s, now))
        while looks[0][0] < self._until_s - DRIFT_WINDOW_S[1]:
            looks.pop(0)
        learnt = [one for at_s, one in looks if at_s <= self._until_s - DRIFT_WINDOW_S[0]]
        if not learnt:
            return now
        drift = 0.5 * float(np.log(np.mean([one.slow_sd**2 for one in learnt])))
        return Noise((*now.theta[:2], drift, float(np.mean([one.theta[3] for one in learnt]))))


class _NewBins(NamedTuple):
    """New bins of a piece. groups : the bins. broken : whether they cannot follow the older bins.
    unfinished : whether nothing can be appended yet."""

    groups: dict[str, dict[str, BinnedChannel]]
    broken: bool
    unfinished: bool


def list_live_candidates(machine: Machine) -> dict[str, list[Candidate]]:
    """Return the searched effects by channel: those that are linear in their size."""
    found: dict[str, list[Candidate]] = {}
    for names in CHANNEL_GROUPS.values():
        every = list_candidates(names, machine, len(HEAD_COLUMNS), False)
        for one in select_onset_candidates(
            [
                c
                for c in every
                if EFFECT_ROWS[c.part.id].probe is not None
                and EFFECT_ROWS[c.part.id].found_by is not FoundBy.ONSET
            ]
        ):
            usual = one._replace(usual=EFFECT_ROWS[one.part.id].scale_to_machine(machine).usual)
            for channel in EFFECT_ROWS[one.part.id].channels:
                found.setdefault(channel, []).append(usual)
    return found


def _bin_piece(
    columns: Mapping[str, npt.NDArray[Any]],
    machine: Machine,
    move: ColumnShift | None,
    tried: Mapping[str, Sequence[Candidate]],
    from_s: float,
    until_s: float,
) -> _NewBins:
    """Return the bins of some rows between two times of the log."""
    begin_s = float(np.asarray(columns["time_s"])[0])

    def move_columns(log: CleanLog, _: Machine) -> CleanLog:
        return shift_log_columns(log, move)

    _, data, _ = prepare_log(columns, machine, move_columns)
    seen = make_channels(data, machine)
    found: dict[str, dict[str, BinnedChannel]] = {}
    for group, names in CHANNEL_GROUPS.items():
        members = [seen[name] for name in names if name in seen]
        if members:
            model = GroupModel(members, machine, data)
            open_ = list_nuisance_columns(model)
            found[group] = {
                one.name: _make_binned_channel(
                    model, one, open_, tried[one.name], begin_s, from_s, until_s
                )
                for one in members
            }
    broken = unfinished = False
    if data.hopper is not None:
        steps_s = [
            begin_s + float(data.hopper.time_s[at])
            for at in (*data.hopper.jumps, *(end for end, _ in data.hopper.gaps))
        ]
        broken = any(at_s > from_s - BIN_S for at_s in steps_s)
        unfinished = any(at_s > until_s - MIN_REFILL_AGE_S for at_s in steps_s)
    return _NewBins(found, broken, unfinished)


def _make_binned_channel(
    model: GroupModel,
    channel: ChannelSeries,
    open_: Sequence[Column],
    tried: Sequence[Candidate],
    begin_s: float,
    from_s: float,
    until_s: float,
) -> BinnedChannel:
    """Build one channel: its prediction, the columns of readings and tolerances in `open_`, and the
    trace of each effect."""
    rows: dict[LineKey, Array] = {PREDICTED_KEY: model.predict(())[channel.name]}
    sums: set[LineKey] = {PREDICTED_KEY} if channel.name == "scale" else set()
    columns: dict[LineKey, Column] = {}
    kept: dict[LineKey, Candidate] = {}
    for k, column in enumerate(open_):
        if channel.name in column.coefficients:
            key: LineKey = (column.label.role.value, column.label.name, k)
            rows[key], columns[key] = (
                make_series(column.coefficients[channel.name], channel.cut),
                column,
            )
            if channel.name == "scale" and column.label.role is ColumnRole.TOLERANCE:
                sums.add(key)
    for one in tried:
        if (one.part.member or 0) <= model.heads:
            key = (one.part.id, "", one.part.member)
            rows[key], kept[key] = (
                model.run_model((one.part,), only=(channel.name,))[channel.name]
                - rows[PREDICTED_KEY],
                one,
            )
            if is_cumulative(one.part, channel.name):
                sums.add(key)
    at_s, measured, lines = _bin_channel(channel, begin_s, from_s, until_s, rows, sums)
    return BinnedChannel(channel, at_s, measured, lines, frozenset(sums), columns, kept)


def _bin_channel(
    channel: ChannelSeries,
    begin_s: float,
    from_s: float,
    until_s: float,
    rows: Mapping[LineKey, Array],
    sums: Collection[LineKey],
) -> tuple[Array, Array, dict[LineKey, Array]]:
    """Return the middles of the bins between two times, (m,), and means over bins of the measured
    values and of each row, (copies, m)."""
    at_s = begin_s + channel.grid.even_s
    width = max(BIN_S, channel.grid.step_s)
    place = np.floor(at_s / width + 1e-6).astype(np.int64)
    starts = np.flatnonzero(np.diff(place, prepend=place[0] - 1))
    count = np.diff(np.append(starts, len(place)))
    stack = np.array([channel.measured, *rows.values()]).reshape(1 + len(rows), channel.copies, -1)
    means = np.add.reduceat(stack, starts, axis=2) / count
    middle_s = np.add.reduceat(at_s, starts) / count
    new = (middle_s > from_s) & (middle_s <= until_s)
    lines = {
        key: (np.diff(one, axis=1, prepend=one[:, :1]) if key in sums else one)[:, new]
        for key, one in zip(rows, means[1:], strict=True)
    }
    return middle_s[new], means[0][:, new], lines


def _join_lines(before: BinnedChannel | None, new: BinnedChannel) -> BinnedChannel:
    """Append new bins; a line that only one of them has is dropped, but a step continues with its
    last value."""
    if before is None or before.measured.shape[0] != new.measured.shape[0]:
        return new
    lines = {
        key: np.concatenate((one, new.lines[key]), axis=1)
        for key, one in before.lines.items()
        if key in new.lines
    }
    for key, one in before.lines.items():
        if key not in new.lines and key not in before.candidates:
            lines[key] = np.concatenate(
                (one, np.repeat(one[:, -1:], len(new.at_s), axis=1)), axis=1
            )
    return before._replace(
        at_s=np.concatenate((before.at_s, new.at_s)),
        measured=np.concatenate((before.measured, new.measured), axis=1),
        lines=lines,
    )


def _keep_lines_since(one: BinnedChannel, since_s: float) -> BinnedChannel:
    begin = int(np.searchsorted(one.at_s, since_s))
    return one._replace(
        at_s=one.at_s[begin:],
        measured=one.measured[:, begin:],
        lines={key: line[:, begin:] for key, line in one.lines.items()},
    )


def _join_copies(one: BinnedChannel, key: LineKey) -> Array:
    line = one.lines[key]
    return np.cumsum(line, axis=1) if key in one.sums else line


def _make_channel_series(one: BinnedChannel) -> ChannelSeries:
    """Build a channel for the search of onsets."""
    like, count = one.like, len(one.at_s)
    step_s = max(BIN_S, like.grid.step_s)
    in_bin = max(1, round(BIN_S / like.grid.step_s))
    grid = Grid(one.at_s, np.arange(count), one.at_s, one.at_s, step_s, True)
    bounds = tuple((k * count, (k + 1) * count) for k in range(like.copies))
    return like._replace(
        measured=one.measured.ravel(),
        grid=grid,
        cut=make_segments(count * like.copies, bounds),
        prior=_calc_noise_of_means(like.prior, like.grid.step_s, in_bin),
    )


def _calc_noise_of_means(prior: NoisePrior, step_s: float, in_bin: int) -> NoisePrior:
    """Return the noise of means over a number of samples, for first-order noise with a white
    floor."""
    apart = np.abs(np.subtract.outer(np.arange(in_bin), np.arange(in_bin)))
    share = float(np.sqrt(np.mean(np.exp(-apart * step_s / prior.fast_s))))
    return prior._replace(
        fast_sd=share * prior.fast_sd,
        floor_sd=prior.floor_sd / np.sqrt(in_bin),
        slow_share=prior.slow_share / share,
        walk_sd=prior.walk_sd * np.sqrt(in_bin),
    )
