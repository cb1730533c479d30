"""How much does a crop yield without topdressing? Its yield curve, with the day rule that it was
fitted with (paper A, eq 3 and 4).

Constants and day rule belong together: 0.359 exp(324.4 I) over days above 4.4 degC is another
curve than the same figures over days above 0 degC (at NDVI 0.5, 82 days give 366 kg urea/ha, 65
days 210). So a crop file either names a set of the closed registry below, or writes out
constants, base temperature and source. A set also brings the line from the response index of the
canopy to that of the harvest (`nitrogen_response`).

docs/agronomy.md lists what of Oklahoma State's table is missing here, and why."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import ConfigDict, Field, model_validator
from topdress.control.agronomy.nitrogen_response import HarvestLine
from topdress.control.frozen_model import FrozenModel

OSU_LIBRARY = (
    "Oklahoma State University, library of yield prediction equations "
    "(nue.okstate.edu/Yield_Potential.htm)"
)
# Wheat of 2005 to 2007, wheat in Australia of 2006, durum of 2006 (Oklahoma State's table).
WHEAT_LINE = HarvestLine(slope=1.69, intercept=-0.70)
# Corn of 2004 (Oklahoma State's table).
CORN_LINE = HarvestLine(slope=1.64, intercept=-0.5287)

EveryDay = Literal["every_day"]


class PublishedYieldCurve(NamedTuple):
    """Holds a published curve a exp(b INSEY), the day rule that it was fitted with, and the
    harvest line of its row."""

    a_t_ha: float
    # This factor multiplies INSEY, which is NDVI per day.
    b_days: float
    # A day counts when its mean air temperature is above this, degC.
    base_temp_c: float | EveryDay
    source: str
    warning: str = ""
    # This is the id of the only crop that may use the set; empty: any.
    only_crop: str = ""
    # This line converts the canopy's response index to the harvest's; None: the table has none.
    line: HarvestLine | None = None


PUBLISHED_YIELD_CURVES: dict[str, PublishedYieldCurve] = {
    "huanghai_2015": PublishedYieldCurve(
        0.359,
        324.4,
        0.0,
        "Chen et al. 2015, Trans. Chin. Soc. Agric. Mach. 46(7), eq 3 and 4",
        "its numbers were made for days above 4.4 degC (osu_winter_wheat_2004); the paper "
        "counts days above 0 degC: "
        "the yield comes out lower and the rate higher",
        only_crop="huanghai_wheat",
    ),
    "osu_winter_wheat_2002": PublishedYieldCurve(
        0.344, 267.65, 4.4, OSU_LIBRARY + ", dryland winter wheat 2002: 4 years, 22 sites"
    ),
    "osu_winter_wheat_2003": PublishedYieldCurve(
        0.500, 267.65, 4.4, OSU_LIBRARY + ", dryland winter wheat 2003: 5 years, 26 sites"
    ),
    "osu_winter_wheat_2004": PublishedYieldCurve(
        0.359, 324.4, 4.4, OSU_LIBRARY + ", dryland winter wheat 2004: 6 years, 30 sites"
    ),
    "osu_winter_wheat_2005": PublishedYieldCurve(
        0.522,
        274.7,
        4.4,
        OSU_LIBRARY + ", dryland winter wheat 2005: 7 years, 34 sites",
        line=WHEAT_LINE,
    ),
    "osu_winter_wheat_2006": PublishedYieldCurve(
        0.532,
        270.1,
        4.4,
        OSU_LIBRARY + ", dryland winter wheat 2006: 8 years, 38 sites",
        line=WHEAT_LINE,
    ),
    "osu_winter_wheat_2007": PublishedYieldCurve(
        0.590,
        258.2,
        4.4,
        OSU_LIBRARY + ", dryland winter wheat 2007: 9 years, 43 sites",
        line=WHEAT_LINE,
    ),
    "osu_durum_2006": PublishedYieldCurve(
        0.322,
        211.5,
        4.4,
        OSU_LIBRARY + ", dryland and irrigated durum wheat 2006: 2 years, 4 sites",
        line=WHEAT_LINE,
    ),
    "osu_wheat_southern_australia_2006": PublishedYieldCurve(
        1.800,
        85.0,
        4.4,
        OSU_LIBRARY + ", rainfed wheat, southern Australia 2006 (D. Cox): 1 year, 1 site",
        line=WHEAT_LINE,
    ),
    "osu_wheat_eastern_australia_2006": PublishedYieldCurve(
        0.580,
        244.94,
        4.4,
        OSU_LIBRARY + ", rainfed wheat, eastern Australia 2006 (R. Heath): 1 year, 1 site",
        line=WHEAT_LINE,
    ),
    # The table's own head says "NDVI / cumulative GDD" for corn. With some 450 of those the
    # 2004 curve would rise by a quarter between NDVI 0 and 0.7; with days since planting the
    # three rows give 10 to 15 t/ha at NDVI 0.7 after 50 days. And its authors say that INSEY is
    # NDVI over the days from planting to sensing
    # (nue.okstate.edu/Algorithm/Algorithm_Outline.htm; Teal et al. 2005).
    "osu_corn_irrigated_2003": PublishedYieldCurve(
        2.3329, 132.46, "every_day", OSU_LIBRARY + ", irrigated corn 2003"
    ),
    "osu_corn_dryland_2003": PublishedYieldCurve(
        1.633, 132.46, "every_day", OSU_LIBRARY + ", dryland corn 2003"
    ),
    "osu_corn_2004": PublishedYieldCurve(
        1.565,
        154.7,
        "every_day",
        OSU_LIBRARY + ", dryland and irrigated corn 2004: 3 years, 7 sites",
        line=CORN_LINE,
    ),
}


def describe_day_rule(base_temp_c: float | EveryDay) -> str:
    """Returns in words which days count."""
    return (
        "every day since sowing"
        if base_temp_c == "every_day"
        else f"days above {base_temp_c:g} degC"
    )


_KEYS_FIXED_BY_CURVE = ("a_t_ha", "b_days", "base_temp_c", "source")


def _allow_either_in_schema(schema: dict[str, Any]) -> None:
    schema["required"] = []
    schema["anyOf"] = [{"required": ["set"]}, {"required": list(_KEYS_FIXED_BY_CURVE)}]
    schema["properties"]["set"]["enum"] = [*PUBLISHED_YIELD_CURVES, None]


class YieldPotential(FrozenModel):
    """Holds the yield without topdressing, a exp(b NDVI / D) in t/ha, and the rule by which the
    D days are counted.

    Written as `{set: NAME}` with a name of PUBLISHED_YIELD_CURVES, or as all of `a_t_ha`, `b_days`,
    `base_temp_c` and `source`. After validation all four hold values in either case. Anything
    in between is refused."""

    model_config = ConfigDict(json_schema_extra=_allow_either_in_schema)

    set: str | None = Field(default=None, description="name of a published set")
    a_t_ha: float = Field(gt=0.0, le=5.0, description="yield at NDVI 0, t/ha")
    b_days: float = Field(gt=0.0, le=1000.0, description="factor of INSEY, days")
    base_temp_c: Annotated[float, Field(ge=-5.0, le=15.0)] | EveryDay = Field(
        description="a day counts when its mean temperature is above this; every_day: each day "
        "since sowing counts"
    )
    source: str = Field(
        min_length=8, description="where constants and day rule were published together"
    )

    @model_validator(mode="before")
    @classmethod
    def _expand_named_set(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        name = data.get("set")
        if name is None:
            missing = [key for key in _KEYS_FIXED_BY_CURVE if data.get(key) is None]
            if missing:
                raise ValueError(
                    f"{', '.join(missing)} missing: allowed is a set "
                    f"({', '.join(PUBLISHED_YIELD_CURVES)}), or all of "
                    f"{', '.join(_KEYS_FIXED_BY_CURVE)} from one source"
                )
            return data
        if name not in PUBLISHED_YIELD_CURVES:
            raise ValueError(
                f"set {name!r} is not known: allowed are {', '.join(PUBLISHED_YIELD_CURVES)}"
            )
        own = {key: getattr(PUBLISHED_YIELD_CURVES[name], key) for key in _KEYS_FIXED_BY_CURVE}
        for key in _KEYS_FIXED_BY_CURVE:
            if key in data and data[key] != own[key]:
                raise ValueError(
                    f"{key} {data[key]!r} contradicts set {name}, which brings "
                    f"{own[key]!r}: constants "
                    "and day rule belong together, leave the key out"
                )
        return {**data, **own}

    @model_validator(mode="after")
    def _check_day_rule(self) -> Self:
        if self.set is not None:
            return self
        for name, known in PUBLISHED_YIELD_CURVES.items():
            same_curve = (
                abs(self.a_t_ha - known.a_t_ha) < 1e-9 and abs(self.b_days - known.b_days) < 1e-9
            )
            if same_curve and not known.only_crop and self.base_temp_c != known.base_temp_c:
                raise ValueError(
                    f"base_temp_c {self.base_temp_c} with the constants of {name}: they "
                    "were published "
                    f"for {describe_day_rule(known.base_temp_c)}; write set: {name}"
                )
        return self

    @property
    def warning(self) -> str:
        """Returns the known fault of the set; empty where it has none."""
        return PUBLISHED_YIELD_CURVES[self.set].warning if self.set is not None else ""

    @property
    def response_line(self) -> HarvestLine | None:
        """Returns the harvest line of the set; None where it has none, or the constants are
        written out."""
        return PUBLISHED_YIELD_CURVES[self.set].line if self.set is not None else None

    @property
    def only_crop(self) -> str:
        """Returns the id of the only crop that may use this set; empty: any."""
        return PUBLISHED_YIELD_CURVES[self.set].only_crop if self.set is not None else ""
