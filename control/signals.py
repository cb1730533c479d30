"""Which numbers does a machine sense, command or log? Each is declared here and nowhere else: its
unit, its ranges, for how long a reading holds, its name on the screen, its words in foreign logs.

The tables of columns (`control.log_row`, Trends, replay, terms, imports, the table of
docs/format-run-log.md) are made of these declarations."""

from __future__ import annotations

from math import inf
from typing import Annotated, Any, NamedTuple, get_type_hints

Range = tuple[float, float]
OptionalFloat = float | None
OptionalInt = int | None
OptionalText = str | None


def N_(message: str) -> str:
    """Marks an English source string for translation; the console translates it when it is
    shown."""
    return message


class ValidFor(NamedTuple):
    """Holds the times, s, for which a reading is valid in each of its uses; infinite where its age
    does not matter, or where this use does not read it. `reason` says why finite times differ."""

    log_s: float
    control_s: float = inf
    safety_s: float = inf
    reason: str = ""


class Signal(NamedTuple):
    """Declares one number of a machine, or one text of its log."""

    unit: str = ""
    # Decimals in the log; None of a text, a whole number or an exact number.
    decimals: int | None = None
    # An exact number is written as the shortest text that reads back as the same double.
    exact: bool = False
    # Range on any machine of this kind, wide on purpose: other values of a log are a finding.
    plausible: Range | None = None
    # Range of a sensor's reading, far wider than that of its driver: others count as never
    # received. A number with this range is a field of `control.readings.Measurements`.
    possible: Range | None = None
    valid_for: ValidFor | None = None
    # Time over which a diagnosis smooths it as an input of a stage, s; None: used as read.
    smoothed_s: float | None = None
    # Name on the screen; empty: the column's own name.
    label: str = ""
    # Channels of one group share their scale on Trends.
    group: str = ""
    # Place in the list of Trends, which begins with what an operator compares most often.
    rank: int = 1000
    # Field of `console.app.units.Units`; empty: `unit` in every system of units.
    shown_as: str = ""
    # Decimals on the screen; None: those of the unit.
    shown_decimals: int | None = 2
    is_on_run: bool = False
    # Name as a variable of a term (docs/terms.md); empty: no term depends on it.
    term_label: str = ""
    # Words in other programs' names of this column (`imports/column_vocabulary.py`), words that
    # exclude it, quantities whose units imply it, and whole names that need no guess.
    words: str = ""
    excluding_words: str = ""
    quantities: tuple[str, ...] = ()
    other_names: str = ""
    # Results that a log without this column lacks, by their key in `drivers/files/foreign_logs.py`.
    losses: tuple[str, ...] = ()
    # Meaning in docs/format-run-log.md.
    meaning: str = ""


_EPOCH = ValidFor(
    1.0,
    0.5,
    0.5,
    "A log keeps the epochs of a receiver at 1 Hz. Safety and control take 2.5 of its own "
    "periods where that is longer.",
)
_DRIVE = ValidFor(0.5, 0.5, 0.5)
_TILT = ValidFor(1.0)
# A supply and a mass change slowly.
_SLOW_SMOOTHED_S = 1.5
# Ground changes within a second what a drive carries: on rough ground (0.5 deg, correlated over
# 3 s) the mean of three rows at 20 Hz is nearest to the pitch behind a sensor's noise (0.1 deg).
_TILT_SMOOTHED_S = 0.1
_HEAD = Signal(
    decimals=4,
    plausible=(-1.0, 1.0),
    possible=(-100.0, 100.0),
    valid_for=ValidFor(
        1.25,
        1.25,
        2.0,
        "The mean leaves a head out after two and a half periods of heads at 2 Hz. The alarm, "
        "which changes the rate to the fallback, waits for four.",
    ),
    group="ndvi",
    shown_decimals=3,
    losses=("canopy",),
    meaning="canopy heads, left to right",
)
_NDRE_HEAD = _HEAD._replace(meaning="in the place of the `ndvi` columns where the heads give NDRE")
_SPEED = Signal(
    "m/s", 4, plausible=(-15.0, 30.0), group="speed", shown_as="speed", losses=("rates",)
)
_EFFORT = Signal(
    "",
    3,
    plausible=(-1000.0, 1000.0),
    possible=(-1000.0, 1000.0),
    valid_for=ValidFor(0.5, 0.5),
    group="effort",
    shown_decimals=1,
    meaning="how hard the drive of the metering shaft, or of the gate, works, in the machine "
    "file's `effort_unit`: % of full duty, A, or N m; empty where it does not tell",
)
_SHAFT = Signal("r/min", plausible=(-1e5, 1e5), group="shaft", shown_as="shaft", losses=("shaft",))
_OPENING = Signal(
    "mm", plausible=(-50.0, 500.0), group="opening", shown_as="opening", losses=("gate",)
)


class LogRow(NamedTuple):
    """Holds one row of a run log: the public columns in their published order; None: unknown.

    Row k holds the measurements as sampled at `time_s`, and the commands computed from them, in
    force until row k+1."""

    time_s: Annotated[
        float,
        Signal(
            "s",
            3,
            term_label=N_("time"),
            other_names="time t t_s timestamp_s seconds elapsed_s",
            meaning="since the log began, strictly increasing; 6 decimals where two rows fall into "
            "one millisecond",
        ),
    ]
    utc: Annotated[
        OptionalText,
        Signal(
            other_names="time_utc",
            meaning="ISO 8601 with milliseconds and Z, of the GNSS epoch",
        ),
    ] = None
    lat_deg: Annotated[
        OptionalFloat,
        Signal(
            "deg",
            9,
            plausible=(-90.0, 90.0),
            valid_for=_EPOCH,
            label=N_("latitude"),
            rank=330,
            shown_decimals=7,
            words="=lat latitude breitengrad =breite geobreite 纬度 latitud",
            other_names="lat latitude latitude_deg",
            losses=("place",),
            meaning="antenna as received, WGS84",
        ),
    ] = None
    lon_deg: Annotated[
        OptionalFloat,
        Signal(
            "deg",
            9,
            plausible=(-180.0, 180.0),
            valid_for=_EPOCH,
            label=N_("longitude"),
            rank=340,
            shown_decimals=7,
            words="=lon =lng =long longitude langengrad =lange geolange 经度 longitud",
            other_names="lon lng long longitude longitude_deg",
            losses=("place",),
            meaning="antenna as received, WGS84",
        ),
    ] = None
    fix_quality: Annotated[
        OptionalInt,
        Signal(
            plausible=(0, 9),
            valid_for=_EPOCH,
            label=N_("GNSS fix quality"),
            rank=300,
            shown_decimals=0,
            words="fix_quality fix_type =fix gps_quality gnss_quality 定位状态 定位质量",
            meaning="NMEA GGA: 0 none, 1 GNSS, 2 differential, 4 RTK fixed, 5 RTK float",
        ),
    ] = None
    satellites: Annotated[
        OptionalInt,
        Signal(
            plausible=(0, 100),
            valid_for=_EPOCH,
            label=N_("satellites"),
            rank=310,
            shown_decimals=0,
            words="satellite satellit =sats =nsat 卫星",
            meaning="used in the fix",
        ),
    ] = None
    hdop: Annotated[
        OptionalFloat,
        Signal(
            "",
            2,
            plausible=(0, 100),
            valid_for=_EPOCH,
            label=N_("GNSS dilution (HDOP)"),
            rank=320,
            words="hdop",
            meaning="horizontal dilution of precision",
        ),
    ] = None
    heading_deg: Annotated[
        OptionalFloat,
        Signal(
            "deg",
            3,
            plausible=(-180.0, 360.0),
            valid_for=_EPOCH,
            label=N_("heading"),
            rank=230,
            shown_decimals=1,
            term_label=N_("heading"),
            words="heading =course =cog bearing =kurs fahrtrichtung 航向 azimut =cap",
            excluding_words="error target soll",
            other_names="heading course course_deg",
            meaning="course over ground, from north, clockwise",
        ),
    ] = None
    pitch_deg: Annotated[
        OptionalFloat,
        Signal(
            "deg",
            3,
            plausible=(-60.0, 60.0),
            possible=(-180.0, 180.0),
            valid_for=_TILT,
            smoothed_s=_TILT_SMOOTHED_S,
            label=N_("pitch"),
            group="tilt",
            rank=240,
            shown_decimals=1,
            term_label=N_("pitch"),
            words="=pitch langsneigung steigung 俯仰 纵坡 坡度",
            losses=("slope",),
            meaning="nose up positive",
        ),
    ] = None
    roll_deg: Annotated[
        OptionalFloat,
        Signal(
            "deg",
            3,
            plausible=(-60.0, 60.0),
            possible=(-180.0, 180.0),
            valid_for=_TILT,
            smoothed_s=_TILT_SMOOTHED_S,
            label=N_("roll"),
            group="tilt",
            rank=250,
            shown_decimals=1,
            term_label=N_("roll"),
            words="=roll querneigung 横滚 侧倾 横坡",
            meaning="right side down positive",
        ),
    ] = None
    speed_mps: Annotated[
        OptionalFloat,
        _SPEED._replace(
            valid_for=_EPOCH,
            smoothed_s=_SLOW_SMOOTHED_S,
            label=N_("GNSS speed"),
            rank=50,
            term_label=N_("travel speed"),
            other_names="gps_speed_mps ground_speed_mps speed_ms speed_m_s speed",
            losses=("rates", "speed"),
            meaning="GNSS ground speed",
        ),
    ] = None
    wheel_speed_mps: Annotated[
        OptionalFloat,
        _SPEED._replace(
            possible=(-100.0, 100.0),
            valid_for=ValidFor(
                1.0,
                0.5,
                0.8,
                "Control goes on with GNSS after ten missed status lines. Safety waits for the "
                "time without a pulse that counts as standstill. A log also keeps the speeds of "
                "boards at 1 Hz.",
            ),
            label=N_("wheel speed"),
            rank=60,
            losses=("rates", "speed"),
            meaning="from wheel pulses",
        ),
    ] = None
    speed_used_mps: Annotated[
        OptionalFloat,
        _SPEED._replace(label=N_("speed used"), rank=40, meaning="the one that control used"),
    ] = None
    ndvi_1: Annotated[OptionalFloat, _HEAD._replace(label=N_("NDVI, head 1"), rank=81)] = None
    ndvi_2: Annotated[OptionalFloat, _HEAD._replace(label=N_("NDVI, head 2"), rank=82)] = None
    ndvi_3: Annotated[OptionalFloat, _HEAD._replace(label=N_("NDVI, head 3"), rank=83)] = None
    ndvi_4: Annotated[OptionalFloat, _HEAD._replace(label=N_("NDVI, head 4"), rank=84)] = None
    ndvi_5: Annotated[OptionalFloat, _HEAD._replace(label=N_("NDVI, head 5"), rank=85)] = None
    ndvi_6: Annotated[OptionalFloat, _HEAD._replace(label=N_("NDVI, head 6"), rank=86)] = None
    ndvi: Annotated[
        OptionalFloat,
        Signal(
            "",
            5,
            plausible=(-1.0, 1.0),
            label=N_("NDVI, fused"),
            group="ndvi",
            rank=80,
            shown_decimals=3,
            words="ndvi",
            losses=("canopy",),
            meaning="fused value that the decision used; where `target_source` is `index_map`, "
            "the map's, levelled to the heads",
        ),
    ] = None
    target_rate_kg_ha: Annotated[
        OptionalFloat,
        Signal(
            "kg/ha",
            exact=True,
            plausible=(0.0, 5000.0),
            label=N_("target rate"),
            group="rate",
            rank=10,
            shown_as="rate",
            shown_decimals=None,
            losses=("target",),
            meaning="target where material released now will land, nudge included; above the "
            "crop's limit (alarm `target_cut`) the limit is applied",
        ),
    ] = None
    nudge_percent: Annotated[
        OptionalFloat,
        Signal(
            "%",
            exact=True,
            plausible=(-100.0, 100.0),
            label=N_("nudge"),
            rank=220,
            shown_decimals=0,
            meaning="the operator's nudge in it",
        ),
    ] = None
    shaft_rpm_cmd: Annotated[
        OptionalFloat,
        _SHAFT._replace(
            exact=True,
            label=N_("shaft, set"),
            rank=140,
            shown_decimals=None,
            meaning="metering shaft, value on the wire after every trim",
        ),
    ] = None
    shaft_rpm: Annotated[
        OptionalFloat,
        _SHAFT._replace(
            decimals=3,
            possible=(-10_000.0, 10_000.0),
            valid_for=_DRIVE,
            label=N_("shaft, measured"),
            rank=150,
            shown_decimals=None,
            term_label=N_("shaft speed"),
            meaning="metering shaft, measured",
        ),
    ] = None
    opening_mm_cmd: Annotated[
        OptionalFloat,
        _OPENING._replace(
            exact=True,
            label=N_("opening, set"),
            rank=160,
            shown_decimals=None,
            meaning="gate, value on the wire after every trim",
        ),
    ] = None
    opening_mm: Annotated[
        OptionalFloat,
        _OPENING._replace(
            decimals=3,
            possible=(-1_000.0, 10_000.0),
            valid_for=_DRIVE,
            label=N_("opening, measured"),
            rank=170,
            shown_decimals=None,
            term_label=N_("opening"),
            meaning="gate, measured",
        ),
    ] = None
    hopper_kg: Annotated[
        OptionalFloat,
        Signal(
            "kg",
            3,
            plausible=(-500.0, 50_000.0),
            possible=(-100_000.0, 100_000.0),
            valid_for=ValidFor(
                2.0, 1.0, 2.0, "The flow trim compares a mass with what has left since."
            ),
            smoothed_s=_SLOW_SMOOTHED_S,
            label=N_("hopper"),
            rank=180,
            shown_as="mass",
            shown_decimals=1,
            term_label=N_("hopper level"),
            other_names="hopper",
            losses=("flow",),
            meaning="scale reading, unfiltered",
        ),
    ] = None
    flow_trim: Annotated[
        OptionalFloat,
        Signal(
            exact=True,
            plausible=(0.0, 10.0),
            label=N_("scale trim"),
            rank=190,
            shown_decimals=3,
            meaning="the scale's correction of the flow model, 1 = none",
        ),
    ] = None
    supply_v: Annotated[
        OptionalFloat,
        Signal(
            "V",
            3,
            plausible=(0.0, 60.0),
            possible=(-1_000.0, 1_000.0),
            valid_for=ValidFor(2.0, safety_s=2.0),
            smoothed_s=_SLOW_SMOOTHED_S,
            label=N_("supply"),
            rank=260,
            term_label=N_("supply voltage"),
            words="voltage =volt =volts battery batterie spannung 电压 supply tension",
            quantities=("voltage",),
            losses=("supply",),
            meaning="supply voltage",
        ),
    ] = None
    applied_rate_kg_ha: Annotated[
        OptionalFloat,
        Signal(
            "kg/ha",
            3,
            plausible=(0.0, 20_000.0),
            label=N_("applied rate"),
            group="rate",
            rank=20,
            shown_as="rate",
            shown_decimals=None,
            meaning="from measured shaft speed, opening and `speed_used_mps` through the log's "
            "machine model",
        ),
    ] = None
    lag_s: Annotated[
        OptionalFloat,
        Signal(
            "s",
            4,
            plausible=(0.0, 60.0),
            label=N_("look-ahead, time"),
            rank=200,
            meaning="response plus drop time used for the look-ahead",
        ),
    ] = None
    lag_m: Annotated[
        OptionalFloat,
        Signal(
            "m",
            4,
            plausible=(-100.0, 500.0),
            label=N_("look-ahead, way"),
            rank=210,
            shown_as="fine_distance",
            shown_decimals=None,
            meaning="the distance used for the look-ahead",
        ),
    ] = None
    state: Annotated[
        OptionalText,
        Signal(
            losses=("state",),
            meaning="`off`, `ready`, `working`, `held`, `calibrating`, `fault`",
        ),
    ] = None
    strategy: Annotated[
        OptionalText,
        Signal(meaning="`opening_first`, `speed_first`; in older logs `balanced`"),
    ] = None
    target_source: Annotated[
        OptionalText,
        Signal(
            meaning="`canopy`, `map`, `map_and_canopy`, `point`, `manual`, `external` (another "
            "display's), `fallback`, `none`, `index_map` (source canopy, heads silent)"
        ),
    ] = None
    work_switch: Annotated[
        OptionalInt,
        Signal(label=N_("work switch"), rank=290, shown_decimals=0, meaning="0 up, 1 down"),
    ] = None
    alarms: Annotated[OptionalText, Signal(meaning="ids, separated by `;`")] = None
    events: Annotated[OptionalText, Signal(meaning="separated by `;`, see [below](#events)")] = None
    # `control.readings.describe_announcement` writes this text.
    speed_told: Annotated[
        OptionalText,
        Signal(
            meaning="what the tractor announced since the row before: age in s, acceleration in "
            "m/s², then pairs of seconds and m/s, separated by blanks"
        ),
    ] = None
    ndre_1: Annotated[OptionalFloat, _NDRE_HEAD] = None
    ndre_2: Annotated[OptionalFloat, _NDRE_HEAD] = None
    ndre_3: Annotated[OptionalFloat, _NDRE_HEAD] = None
    ndre_4: Annotated[OptionalFloat, _NDRE_HEAD] = None
    ndre_5: Annotated[OptionalFloat, _NDRE_HEAD] = None
    ndre_6: Annotated[OptionalFloat, _NDRE_HEAD] = None
    ndre: Annotated[
        OptionalFloat,
        Signal(
            "",
            5,
            plausible=(-1.0, 1.0),
            label=N_("NDRE, fused"),
            group="ndvi",
            rank=350,
            shown_decimals=3,
            losses=("canopy",),
            meaning="fused value of NDRE, in the place of `ndvi`",
        ),
    ] = None
    # Efforts are in the machine file's `effort_unit`: % of full duty, A or N m.
    shaft_effort: Annotated[
        OptionalFloat, _EFFORT._replace(label=N_("effort of the shaft"), rank=270)
    ] = None
    gate_effort: Annotated[
        OptionalFloat, _EFFORT._replace(label=N_("effort of the gate"), rank=280)
    ] = None
    # This column stands only in logs of machines whose sections have valves.
    sections_cmd: Annotated[
        OptionalText,
        Signal(
            meaning="only of machines whose sections have valves: the command of each, left to "
            "right, separated by `;`: 1 open, 0 closed; the valve follows after the machine "
            "file's `open_s` or `close_s`"
        ),
    ] = None


def read_signals(row: type[Any]) -> dict[str, Signal]:
    """Returns the declarations among a class's annotations, by field."""
    hints = get_type_hints(row, include_extras=True)
    return {
        name: note
        for name, kind in hints.items()
        for note in getattr(kind, "__metadata__", ())
        if isinstance(note, Signal)
    }


SIGNALS = read_signals(LogRow)
# For how long the reading of a column is valid in each use.
VALID_FOR = {name: one.valid_for for name, one in SIGNALS.items() if one.valid_for is not None}
