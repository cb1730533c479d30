"""The yield curve of a crop, tied to the day rule it was fitted with (paper A, eq 3 and 4).

Constants and day rule are one thing: 0.359 exp(324.4 I) over days above 4.4 degC is another curve than the same
figures over days above 0 degC (at NDVI 0.5, 82 days give 366 kg urea/ha, 65 days 210). So a crop file either names
a set of the closed registry below, or writes out all of its own: constants, base temperature and source.
"""
from __future__ import annotations

from typing import Any, NamedTuple, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

OSU_LIBRARY = "Oklahoma State University, library of yield prediction equations (nue.okstate.edu/Yield_Potential.htm)"


class YieldSet(NamedTuple):
    """A published curve a exp(b INSEY) with the day rule it was fitted with."""

    a_t_ha: float
    b_days: float          # multiplies INSEY (NDVI per day)
    base_temp_c: float     # a day counts when its mean air temperature is above this
    source: str
    warning: str = ""
    only_crop: str = ""    # id of the one crop that may use it; empty: any


YIELD_SETS: dict[str, YieldSet] = {
    "huanghai_2015": YieldSet(
        0.359, 324.4, 0.0,
        "Chen et al. 2015, Trans. Chin. Soc. Agric. Mach. 46(7), eq 3 and 4",
        "these constants were published for days above 4.4 degC (osu_winter_wheat_2004); "
        "the paper counts days above 0 degC, which lowers the estimated yield and raises the rate",
        only_crop="huanghai_wheat"),
    "osu_winter_wheat_2004": YieldSet(
        0.359, 324.4, 4.4, OSU_LIBRARY + ", dryland winter wheat 2004: 6 years, 30 sites"),
    "osu_winter_wheat_2005": YieldSet(
        0.522, 274.7, 4.4, OSU_LIBRARY + ", dryland winter wheat 2005: 7 years, 34 sites"),
    "osu_winter_wheat_2006": YieldSet(
        0.532, 270.1, 4.4, OSU_LIBRARY + ", dryland winter wheat 2006: 8 years, 38 sites"),
    "osu_winter_wheat_2007": YieldSet(
        0.590, 258.2, 4.4, OSU_LIBRARY + ", dryland winter wheat 2007: 9 years, 43 sites"),
    "osu_durum_2006": YieldSet(
        0.322, 211.5, 4.4, OSU_LIBRARY + ", dryland and irrigated durum wheat 2006: 2 years, 4 sites"),
}

_FIXED_BY_SET = ("a_t_ha", "b_days", "base_temp_c", "source")


def _schema_takes_either(schema: dict[str, Any]) -> None:
    schema["required"] = []
    schema["anyOf"] = [{"required": ["set"]}, {"required": list(_FIXED_BY_SET)}]
    schema["properties"]["set"]["enum"] = [*YIELD_SETS, None]


class YieldPotential(BaseModel):
    """Yield without topdressing, a exp(b NDVI / D) in t/ha, with the rule by which the D days are counted.

    Written as `{set: NAME}` with a name of YIELD_SETS, or as all of `a_t_ha`, `b_days`, `base_temp_c` and `source`.
    After validation all four hold values in either case. Anything in between is refused.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, json_schema_extra=_schema_takes_either)

    set: str | None = Field(default=None, description="name of a published set")
    a_t_ha: float = Field(gt=0.0, le=5.0, description="yield at NDVI 0, t/ha")
    b_days: float = Field(gt=0.0, le=1000.0, description="factor of INSEY, days")
    base_temp_c: float = Field(ge=-5.0, le=15.0, description="a day counts when its mean temperature is above this")
    source: str = Field(min_length=8, description="where constants and day rule were published together")

    @model_validator(mode="before")
    @classmethod
    def _expand(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        name = data.get("set")
        if name is None:
            missing = [key for key in _FIXED_BY_SET if data.get(key) is None]
            if missing:
                raise ValueError(f"{', '.join(missing)} missing: allowed is a set ({', '.join(YIELD_SETS)}), or all of "
                                 f"{', '.join(_FIXED_BY_SET)} from one source")
            return data
        if name not in YIELD_SETS:
            raise ValueError(f"set {name!r} is not known: allowed are {', '.join(YIELD_SETS)}")
        own = {key: getattr(YIELD_SETS[name], key) for key in _FIXED_BY_SET}
        for key in _FIXED_BY_SET:
            if key in data and data[key] != own[key]:
                raise ValueError(f"{key} {data[key]!r} contradicts set {name}, which brings {own[key]!r}: constants "
                                 "and day rule belong together, leave the key out")
        return {**data, **own}

    @model_validator(mode="after")
    def _own_day_rule(self) -> Self:
        if self.set is not None:
            return self
        for name, known in YIELD_SETS.items():
            same_curve = abs(self.a_t_ha - known.a_t_ha) < 1e-9 and abs(self.b_days - known.b_days) < 1e-9
            if same_curve and not known.only_crop and self.base_temp_c != known.base_temp_c:
                raise ValueError(f"base_temp_c {self.base_temp_c:g} with the constants of {name}: they were published "
                                 f"for days above {known.base_temp_c:g} degC; write set: {name}")
        return self

    @property
    def warning(self) -> str:
        """What is wrong with the set itself; empty when nothing is."""
        return YIELD_SETS[self.set].warning if self.set is not None else ""

    @property
    def only_crop(self) -> str:
        """Id of the one crop that may use this set; empty: any."""
        return YIELD_SETS[self.set].only_crop if self.set is not None else ""
