"""Which words do people use for the columns of a machine's log and of a map? The lists cover
English, German, Chinese, French and Spanish.

A word matches wherever it occurs in a name. `=word` matches a whole part of the name (`=rate` is in
`target_rate`, not in `acceleration`), `^word` its beginning, `$word` the end of the name. Names are
compared in small letters, those of logs without accents.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Iterable
from functools import cache
from typing import NamedTuple

from topdress.control.signals import SIGNALS
from topdress.drivers.files.imports.units import find_quantity

# Number of letters of a name that a shapefile keeps.
SHAPEFILE_NAME_LENGTH = 10
WordList = tuple[str, ...]


class ColumnSubject(NamedTuple):
    """Describes a kind of column. `needs` are groups of words; a name must contain a word of each
    group. A name with a word of `never` is excluded.

    `reading` and `command` are the log columns of its measured and its commanded value; empty
    without such a column. `quantities` lists quantities whose units imply this kind, unless the
    words of the name contradict.
    """

    id: str
    needs: tuple[WordList, ...]
    reading: str = ""
    command: str = ""
    never: WordList = ()
    quantities: WordList = ()


def _split_words(text: str) -> WordList:
    return tuple(text.split())


# Words of drives that are no metering drives.
_OTHER_DRIVES = _split_words(
    "engine =eng =pto zapfwelle =fan geblase turbin ^motordreh 发动机 风机 =wind windgesch"
)

# The first subject that fits is chosen, so special subjects precede general ones.
COLUMN_SUBJECTS = (
    ColumnSubject(
        "wheel speed",
        (
            _split_words("wheel =rad ^rad 轮速 radar roue odometer"),
            _split_words("speed =spd ^spd velocity geschw 速 vitesse"),
        ),
        "wheel_speed_mps",
    ),
    ColumnSubject(
        "working width",
        (
            _split_words("width breite 幅宽 largeur wdth swath"),
            _split_words("work arbeit implement 工作 作业 swath swth"),
        ),
    ),
    ColumnSubject("altitude", (_split_words("altitude =alt elevation hohe 海拔 高程"),)),
    # A column of which a name needs one word is declared with its words.
    *(
        ColumnSubject(
            column,
            (_split_words(one.words),),
            column,
            never=_split_words(one.excluding_words),
            quantities=one.quantities,
        )
        for column, one in SIGNALS.items()
        if one.words
    ),
    ColumnSubject(
        "hopper",
        (
            _split_words(
                "hopper =tank =bin behalter gewicht weight 料箱 肥箱 料仓 重量 "
                "waage fullstand poids "
                "tremie"
            ),
        ),
        "hopper_kg",
        never=_split_words(
            "temp pressure druck applied target yield ertrag crop total =n =rate ^rate "
            "apprate accel =acc ^beschl 加速"
        ),
        quantities=("mass",),
        # The g of an acceleration is no gram.
    ),
    ColumnSubject(
        "gate",
        (
            _split_words(
                "opening =gate schieber offnung 开度 闸门 =flap klappe slide aperture ouverture"
            ),
        ),
        "opening_mm",
        "opening_mm_cmd",
        never=_split_words("time zeit =current strom =amps 电流 torque 扭矩 effort"),
    ),
    ColumnSubject(
        "rate",
        (
            _split_words(
                "=rate ^rate targetrat tgtrat controlrat appliedrat applrat =apprate =rt "
                "ausbring =dose "
                "dosis =dosi =dosagem aufwand =menge ^istmenge sollmenge zielmenge "
                "streumenge dungemenge "
                "=gabe applied =appl =debit =taux =taxa =tasso =dawka "
                "норма 施肥量 施用量 亩用量 =dosage "
                "目标量"
            ),
        ),
        "applied_rate_kg_ha",
        "target_rate_kg_ha",
        never=_split_words(
            "sample baud yaw turn update frame area total fuel crop grain yield ertrag 产量 =kg =n"
        ),
        quantities=("rate",),
    ),
    ColumnSubject(
        "shaft",
        (
            _split_words(
                "shaft dosierwelle metering dosier 排肥轴 排肥 auger schnecke "
                "drehzahl 转速 =rpm motor "
                "=drive antrieb 电机 roller spindle revolution"
            ),
        ),
        "shaft_rpm",
        "shaft_rpm_cmd",
        never=(*_OTHER_DRIVES, *_split_words("temp torque moment 扭矩 current strom wheel")),
        quantities=("rotation",),
    ),
    ColumnSubject(
        "flow",
        (_split_words("=flow massflow durchfluss massenstrom 流量"),),
        "applied_rate_kg_ha",
        "target_rate_kg_ha",
        never=_split_words("crop grain yield ertrag korn 产量 fuel oil hydraul"),
        quantities=("flow",),
    ),
    ColumnSubject(
        "speed",
        (_split_words("speed =spd velocity geschw 车速 速度 vitesse velocidad =sog"),),
        "speed_mps",
        never=(*_OTHER_DRIVES, *_split_words("limit angular")),
        quantities=("speed",),
    ),
    ColumnSubject(
        "work",
        (
            _split_words(
                "=work working arbeit 作业 工作 =lift hubwerk =switch schalter implement "
                "section spreading "
                "=state status travail"
            ),
        ),
        "work_switch",
        never=_split_words(
            "width breite 幅宽 pressure druck time zeit hours stunden area flache temp"
        ),
    ),
    *(
        ColumnSubject(
            "effort",
            (
                _split_words(
                    "current =curr strom =amps 电流 courant corriente torque "
                    "=moment drehmoment 扭矩 "
                    "couple effort"
                ),
                of,
            ),
            effort,
            never=(
                *_OTHER_DRIVES,
                *_split_words(
                    "speed =spd rate temp pos limit max total ^session =position wheel =rad "
                    "section pass target soll set"
                ),
            ),
        )
        for of, effort in (
            (_split_words("opening =gate schieber 开度 闸门 =flap klappe slide"), "gate_effort"),
            (
                _split_words(
                    "shaft dosier metering 排肥 auger schnecke motor =drive antrieb 电机 roller "
                    "spindle "
                    "=current =torque =curr 电流 扭矩"
                ),
                "shaft_effort",
            ),
        )
    ),
)
# Words of targets and, below, of applied amounts: of rates in logs and maps alike
# (`find_rate_role`), and of drives. They are English, German, French, Spanish, Italian, Portuguese,
# Dutch, Polish, Russian and Chinese, and Ag Leader's Rt_Tgt and Rt_Apd, Deere's ControlRate.
TARGET_WORDS = _split_words(
    "target =tgt ^tgt trgt =targ soll ziel desired demand wanted setpoint set_point =set "
    "prescri recomm "
    "=recom =rx =rx1 control_rat controlrat vorgabe consign cible =cibl objecti objetiv "
    "=obj prevu previst "
    "alvo obiettiv =doel gewenst ingesteld zadan задан целев 指令 设定 目标 给定 处方 推荐"
)
APPLIED_WORDS = _split_words(
    "actual =act =ist ^ist measured =meas applied =apd ^apd gemessen ausgebracht "
    "tatsachlich reel =real "
    "realis mesure appliqu =appli aplicad =aplic applicata applicato erogat effettiv "
    "effectif effectiv "
    "werkelijk rzeczywist wykonan факт 实际 测量 已施"
)
COMMAND_WORDS = (
    *TARGET_WORDS,
    *_split_words("=cmd command =ref request =pwm =duty =esc =sp stellwert"),
)
# Words of a command, even if the name also has a word of a reading.
RAW_COMMAND_WORDS = _split_words("=pwm =duty =esc")
READING_WORDS = (*APPLIED_WORDS, *_split_words("feedback =fb 反馈 sensor"))
# A command with one of these words is not a count of steps.
QUANTITY_WORDS = _split_words("speed =spd rpm drehzahl 转速 geschw opening offnung 开度 =mm")
# Words of a reading, even if the name also has a word of a command.
PLAIN_READING_WORDS = _split_words("actual =act =ist")

# Words of times, the plain words first.
TIME_WORDS = _split_words(
    "=time =t timestamp =zeit uhrzeit zeitstempel 时间 时刻 =utc heure =hora datetime elapsed "
    "time millis "
    "=tiempo =tempo =temps =tijd =czas =время"
)
PLAIN_TIME_WORDS = TIME_WORDS[:6]
# Words that exclude a time despite a word of time.
TIME_EXCLUDING_WORDS = _split_words("lag zeitzone timezone")
DATE_WORDS = _split_words("=date =datum 日期 =fecha =tag =day")
UTC_WORDS = _split_words("utc gmt zulu")
# Words of switches that may be on when raised, or on when lowered.
AMBIGUOUS_SWITCH_WORDS = _split_words("=lift hubwerk raised gehoben stop aus")
# Words of a switch that is on.
SWITCH_ON_WORDS = _split_words(
    "1 on true yes working work active down ein an ja arbeit 作业 工作 是 开 spreading engaged"
)


# Words of a harvester's log; the first word found is shown.
HARVEST_WORDS = _split_words("yield ertrag 产量 crop_flow grain")

# Names that need no guess: a log with these names is read unchanged. A unit may follow.
COLUMN_OF_WHOLE_NAME = {
    **dict.fromkeys(("speed_km_h", "speed_kph", "speed_kmh"), "speed_kmh"),
    **{name: column for column, one in SIGNALS.items() for name in one.other_names.split()},
}
# Names of columns with seconds, dates or texts of dates.
DATE_NAMES = ("timestamp", "datetime", "date_time", "date time", "time_stamp")

# Kinds of a map's columns by words; the first match decides. A rate needs a word of its own, and no
# other or last word that names something else.
MAP_COLUMN_KINDS: tuple[tuple[str, WordList], ...] = (
    (
        "a measurement",
        _split_words(
            "=ec =eca =ecsh =ecdp =conductivity =cond =leitfähigkeit =ph =om =soc =cec "
            "=clay =sand =silt =elev =elevation "
            "=alt =altitude =height =slope =aspect =ndvi =ndre =ndmi =evi =lai =yield "
            "=ertrag =rendement =moisture "
            "=feuchte =date =time =year =day =count =pixels =x =y =lat =lon =latitude "
            "=longitude =width =speed =price "
            "=cost =seed =seeds =seeding =planting =population =growth =infiltration "
            "=temperature =rain =erntemenge "
            "产量 电导率 有机质 高程 坡度 水分"
        ),
    ),
    (
        "",
        _split_words(
            "=nitrate =substrate =moderate =separate =corporate =accurate =calibrate "
            "=operate =carbonate "
            "=elaborate =regenmenge"
        ),
    ),
    (
        "rate",
        _split_words(
            "=rate =rates =rx =rx1 =dose =doses =dosis =dosen =dosage =dosierung =tgt "
            "=target =targetrate =tgtrate "
            "=targetrat =tgtrat =applrate =apprate =applicationrate =appliedrate "
            "=appliedrat =vrate =vrt =vra "
            "=prescription =prescribed =prescr =recommendation =recomm =recommended =appl "
            "=application =applied =menge "
            "=sollmenge =zielmenge =aufwandmenge =ausbringmenge =streumenge =gabe "
            "=düngemenge =duengemenge =soll "
            "=sollwert =setpoint =debit =débit =taux =cantidad =dosi =norma =aufwand $rate "
            "$menge $gabe "
            "施肥量 用量 处方 推荐量 推荐施 目标量 目标施 追肥量"
        ),
    ),
    (
        "a number or a class",
        _split_words(
            "=id =fid =oid =objectid =gid =uid =pk =key =idx =index =nr =no =num =number "
            "=nummer =numero =seq =row =col "
            "=column =code =gridcode =zone =zones =zona =zonen =class =classes =klasse "
            "=clase =classe =cls =cluster "
            "=category =kategorie =level =group =grp =rank =type 编号 序号 等级 类别 分区"
        ),
    ),
    (
        "a size",
        _split_words(
            "=area =areas =flaeche =fläche =surface =superficie =acres =acre =hectare "
            "=hectares =hektar =ha =ac =m2 "
            "=perimeter =length =leng =len =shape =total =sum =kg =mass =weight =amount "
            "=tons 面积 周长 总量"
        ),
    ),
)


@cache
def fold_column_name(name: str) -> str:
    """Returns a name in small letters without accents, with parts joined by `_`: `targetRate` and
    `Target-Rate` become `target_rate`."""
    plain = unicodedata.normalize("NFKC", name).replace("ß", "ss")
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", plain)
    letters = "".join(
        c for c in unicodedata.normalize("NFKD", spaced.casefold()) if not unicodedata.combining(c)
    )
    return re.sub(r"[\W_]+", "_", letters).strip("_")


def has_any_word(name: str, words: WordList) -> bool:
    """Returns whether a folded name has one of the words."""
    parts = name.split("_")
    for word in words:
        start, rest = word[0], word[1:]
        if start == "=":
            found = rest in parts
        elif start == "^":
            found = any(part.startswith(rest) for part in parts)
        elif start == "$":
            found = name.endswith(rest)
        else:
            found = word in name
        if found:
            return True
    return False


def find_rate_role(name: str) -> str:
    """Returns the role of a rate by its column's unchanged name: `wanted`, `done`, or empty without
    a word of a role."""
    plain = fold_column_name(name)
    if has_any_word(plain, TARGET_WORDS):
        return "done" if has_any_word(plain, PLAIN_READING_WORDS) else "wanted"
    return "done" if has_any_word(plain, APPLIED_WORDS) else ""


def find_subject(name: str, quantity: str | None) -> ColumnSubject | None:
    """Returns the subject of a folded name. A unit of `quantity`, where given, outweighs
    contradicting words: a speed in r/min is no ground speed."""
    worded = [
        subject
        for subject in COLUMN_SUBJECTS
        if all(has_any_word(name, group) for group in subject.needs)
        and not has_any_word(name, subject.never)
    ]
    if quantity is None or quantity == "share" or (worded and not worded[0].reading):
        return worded[0] if worded else None
    fitting = [subject for subject in worded if is_unit_fitting(subject.reading, quantity)]
    by_unit = [
        subject
        for subject in COLUMN_SUBJECTS
        if quantity in subject.quantities and not has_any_word(name, subject.never)
    ]
    return next(iter([*fitting, *by_unit]), None)


def has_time_column(names: Iterable[str]) -> bool:
    """Returns whether one of a table's columns is a time, by the names in the file."""
    return any(
        has_any_word(fold_column_name(name), TIME_WORDS)
        and not has_any_word(fold_column_name(name), TIME_EXCLUDING_WORDS)
        for name in names
    )


def has_places_without_time(names: Collection[str]) -> bool:
    """Returns whether columns hold positions and no time: points of a map instead of a log."""
    subjects = {
        subject.reading
        for name in names
        if (subject := find_subject(fold_column_name(name), None)) is not None
    }
    return {"lat_deg", "lon_deg"} <= subjects and not has_time_column(names)


def is_unit_fitting(column: str, quantity: str) -> bool:
    """Returns whether a log column can be given in a unit of this quantity: a rate also as a flow
    over the covered area, or as a volume of known density."""
    own = find_quantity(column)
    return (
        own is None or own == quantity or (own, quantity) in (("rate", "flow"), ("rate", "volume"))
    )
