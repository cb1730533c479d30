"""How are the NMEA 0183 sentences of GNSS receivers decoded to fixes? GGA, RMC, VTG, GNS and GLL
are grouped into epochs of one UTC time; ZDA gives the date.

GNS, then GLL, are used for receivers that send no GGA. Talkers that are not receivers (IN, EC, ...)
are used on lines without a receiver. A less preferred source is ignored until the preferred source
has been silent for 5 s.

Latency: a fix is released with the last sentence type that the previous two epochs have in common,
so the decoder adds nothing to the receiver's own sending time. Only the first epoch, and an epoch
whose last sentence was lost, wait for the next epoch to begin: one period. A sentence that arrives
after the release and adds a missing speed releases the completed epoch again. `GnssFix.time_s` is
always the arrival of the first sentence of the epoch, so that a late release never appears fresh.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, date, datetime, timedelta

from topdress.control.readings import GnssFix
from topdress.drivers.devices.device import Receiver
from topdress.drivers.devices.lines import IgnoredSentence, LineDecoder, RejectedSentence
from topdress.drivers.devices.nmea import GNSS_TALKERS, Sentence, parse_sentence

DAY_MS = 86_400_000
PREFERRED_SENTENCES = {"GNS": ("GGA",), "GLL": ("GGA", "GNS", "RMC")}
# Silence of the preferred source of positions after which a less preferred source counts, s.
PREFERRED_TIMEOUT_S = 5.0
# Time for which a receiver's earlier time must continue before it counts as a new clock, s.
NEW_CLOCK_DELAY_S = 5.0


@dataclass(slots=True)
class _Epoch:
    """Collects the sentences of one UTC time."""

    time_of_day_ms: int
    first_s: float
    sentences: dict[str, Sentence] = field(default_factory=dict)
    handed_over: bool = False

    @property
    def has_speed(self) -> bool:
        """Whether a sentence of this epoch has given a speed."""
        return any(sentence.speed_mps is not None for sentence in self.sentences.values())


class GnssDecoder(LineDecoder[GnssFix]):
    """Decodes bytes to fixes.

    Counted as rejected:
    - `bad_checksum`, `missing_checksum`, `malformed`, `impossible_value`, `overlong`;
    - `time_backwards`: an epoch earlier than the epoch before, and a VTG that follows it. After 5 s
    of continuing time the earlier time is accepted as the receiver's new clock;
    - `duplicate_epoch`: the same talker repeats a type for the same time; the first sentence is
    used;
    - `garbage`: text that is no sentence.

    Counted as ignored:
    - every other sentence type by its name: ZDA, although its date is used; GNS and GLL of a
    receiver that sends GGA; talkers that are not receivers, with their type;
    - `no_fix`, and `comment` for lines beginning with #;
    - `other_talker`: the sentence of a second constellation for the same epoch; the first is used;
    - `no_epoch`: VTG carries no time, and a VTG before the first epoch has no place.

    Parameters
    ----------
    live : whether fixes are released as early as possible (see the module's text). False, for
    recordings, releases each epoch once, whole, when the next epoch begins or at `flush`.
    """

    framed = True

    def __init__(self, live: bool = True) -> None:
        super().__init__()
        self._live = live
        self._epoch: _Epoch | None = None
        self._types_of_last_epochs: tuple[list[str], list[str]] = ([], [])
        # The newest date, and the time of day with which the date came.
        self._dated: tuple[date, int] | None = None
        # The last backward time of day, and the arrival of the first backward time, s.
        self._behind: tuple[int, float] | None = None
        # The last arrival of each sentence type, and of "receiver" for any GNSS talker, s.
        self._heard_s: dict[str, float] = {}

    def flush(self, time_s: float) -> list[GnssFix]:
        """Ends a recording and returns the fixes of the last line and the last epoch."""
        return super().flush(time_s) + self._close_epoch()

    def _line(self, line: bytes, time_s: float) -> list[GnssFix]:
        if not line.startswith(b"#"):
            return super()._line(line, time_s)
        self.counts.ignore("comment")
        self.counts.foreign += 1
        return []

    def _decode_sentence(self, sentence: bytes, time_s: float) -> list[GnssFix]:
        try:
            return self._take_sentence(
                self._select_sentence(parse_sentence(sentence), time_s), time_s
            )
        except IgnoredSentence as kind:
            # A receiver without a fix still counts as present.
            if str(kind) == "no_fix":
                self._note_talker(sentence[:2].decode(), sentence[2:5].decode(), time_s)
            raise

    def _select_sentence(self, sentence: Sentence, time_s: float) -> Sentence:
        """Returns the sentence if no preferred source has spoken recently. Raises IgnoredSentence
        otherwise.

        All bytes of a recording may have the same time, so a source that has spoken once stays
        preferred there.
        """
        if sentence.type == "ZDA":
            assert sentence.date is not None and sentence.time_of_day_ms is not None
            self._dated = sentence.date, sentence.time_of_day_ms
            raise IgnoredSentence("ZDA")
        receiver = sentence.talker in GNSS_TALKERS
        if not receiver and self._has_spoken("receiver", time_s):
            raise IgnoredSentence(sentence.talker + sentence.type)
        if sentence.type in PREFERRED_SENTENCES and any(
            self._has_spoken(kind, time_s) for kind in PREFERRED_SENTENCES[sentence.type]
        ):
            raise IgnoredSentence(sentence.type)
        self._note_talker(sentence.talker, sentence.type, time_s)
        return sentence

    def _note_talker(self, talker: str, kind: str, time_s: float) -> None:
        self._heard_s[kind] = time_s
        if talker in GNSS_TALKERS:
            self._heard_s["receiver"] = time_s

    def _has_spoken(self, kind: str, time_s: float) -> bool:
        heard_s = self._heard_s.get(kind)
        return heard_s is not None and time_s - heard_s < PREFERRED_TIMEOUT_S

    def _take_sentence(self, sentence: Sentence, time_s: float) -> list[GnssFix]:
        epoch, closed = self._find_epoch(sentence, time_s)
        earlier = epoch.sentences.get(sentence.type)
        if earlier is not None:
            if earlier.talker == sentence.talker:
                raise RejectedSentence("duplicate_epoch")
            raise IgnoredSentence("other_talker")
        brings_speed = sentence.speed_mps is not None and not epoch.has_speed
        epoch.sentences[sentence.type] = sentence
        if sentence.date is not None:
            self._dated = sentence.date, epoch.time_of_day_ms
        if not self._live:
            return closed
        if brings_speed if epoch.handed_over else sentence.type == self._find_ending_type():
            closed.append(self._make_fix(epoch))
            epoch.handed_over = True
        return closed

    def _find_epoch(self, sentence: Sentence, time_s: float) -> tuple[_Epoch, list[GnssFix]]:
        """Returns the epoch of a sentence, and the fix of the previous epoch where the sentence
        begins a new epoch."""
        epoch = self._epoch
        if sentence.time_of_day_ms is None:
            if epoch is None:
                raise IgnoredSentence("no_epoch")
            if self._behind is not None:
                raise RejectedSentence("time_backwards")
            return epoch, []
        if epoch is not None and sentence.time_of_day_ms == epoch.time_of_day_ms:
            return epoch, []
        if (
            epoch is not None
            and _calc_time_ahead_ms(sentence.time_of_day_ms, epoch.time_of_day_ms) < 0
        ):
            self._check_new_clock(sentence.time_of_day_ms, time_s)
        self._behind = None
        closed = self._close_epoch()
        self._epoch = _Epoch(sentence.time_of_day_ms, time_s)
        return self._epoch, closed

    def _check_new_clock(self, time_of_day_ms: int, time_s: float) -> None:
        """Accepts a backward time as the receiver's new clock, or raises RejectedSentence."""
        if self._behind is None or _calc_time_ahead_ms(time_of_day_ms, self._behind[0]) < 0:
            self._behind = time_of_day_ms, time_s
        self._behind = time_of_day_ms, self._behind[1]
        if time_s - self._behind[1] < NEW_CLOCK_DELAY_S:
            raise RejectedSentence("time_backwards")

    def _find_ending_type(self) -> str | None:
        last, before = self._types_of_last_epochs
        common = [kind for kind in last if kind in before] or last
        return common[-1] if common else None

    def _close_epoch(self) -> list[GnssFix]:
        epoch, self._epoch = self._epoch, None
        if epoch is None:
            return []
        self._types_of_last_epochs = list(epoch.sentences), self._types_of_last_epochs[0]
        return [] if epoch.handed_over else [self._make_fix(epoch)]

    def _make_fix(self, epoch: _Epoch) -> GnssFix:
        gga, gns, gll, rmc, vtg = (
            epoch.sentences.get(kind) for kind in ("GGA", "GNS", "GLL", "RMC", "VTG")
        )
        place = gga or gns or rmc or gll
        assert place is not None and place.lat_deg is not None and place.lon_deg is not None
        moving = rmc if rmc is not None and rmc.speed_mps is not None else vtg
        headed = rmc if rmc is not None and rmc.heading_deg is not None else vtg
        return GnssFix(
            time_s=epoch.first_s,
            lat_deg=place.lat_deg,
            lon_deg=place.lon_deg,
            fix_quality=place.fix_quality or 0,
            satellites=place.satellites,
            hdop=place.hdop,
            speed_mps=moving.speed_mps if moving else None,
            heading_deg=headed.heading_deg if headed else None,
            utc=self._format_utc(epoch.time_of_day_ms),
        )

    def _format_utc(self, time_of_day_ms: int) -> str | None:
        if self._dated is None:
            return None
        day, dated_ms = self._dated
        # The time is past midnight, and no RMC has given the new date yet.
        if time_of_day_ms < dated_ms - DAY_MS // 2:
            day += timedelta(days=1)
        # The new date arrived before the last epoch of the old date.
        elif time_of_day_ms > dated_ms + DAY_MS // 2:
            day -= timedelta(days=1)
        at = datetime(day.year, day.month, day.day, tzinfo=UTC) + timedelta(
            milliseconds=time_of_day_ms
        )
        return at.strftime("%Y-%m-%dT%H:%M:%S.") + f"{time_of_day_ms % 1000:03d}Z"


def _calc_time_ahead_ms(later_ms: int, earlier_ms: int) -> int:
    """Returns the time in ms by which one time of day is ahead of another, by the shorter way round
    midnight: -12 h to 12 h."""
    return (later_ms - earlier_ms + DAY_MS // 2) % DAY_MS - DAY_MS // 2


RECEIVER = Receiver(
    protocol="nmea0183",
    captured_as="gnss",
    make_decoder=GnssDecoder,
)
