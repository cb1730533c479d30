"""A job: what is to be done where, by which strategy; and, for the simulated machine, the
ground it works on."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable
from typing import Annotated, Literal

from pydantic import Field, model_validator
from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.growth import GrowthStage
from topdress.control.agronomy.noa import Rule, prepare_rule
from topdress.control.agronomy.response import ResponseRule
from topdress.control.field.boundary import Boundary
from topdress.control.frozen_model import FrozenModel
from topdress.control.orders import MAP_SOURCES, Strategy, TargetSource

Rate = Annotated[float, Field(ge=0, le=2000)]
Metres = Annotated[float, Field(ge=0.01, le=1000)]
NRate = Annotated[float, Field(ge=0, le=1000)]  # of N, not of product
# of a corner, from the field's origin
CornerOffset = Annotated[float, Field(ge=-100_000, le=100_000)]
Hz = Annotated[float, Field(ge=0.01, le=20)]
MAX_CORNERS = 20_000
MAX_PLANTS = 1_000_000  # as many as a plant list may have
Kmh = Annotated[float, Field(gt=0, le=30)]
Name = Annotated[str, Field(max_length=80)]


class Wanted(FrozenModel):
    """Where the target comes from."""

    source: Literal[
        TargetSource.CANOPY,
        TargetSource.MAP,
        TargetSource.POINT,
        TargetSource.MANUAL,
        TargetSource.MAP_AND_CANOPY,
        TargetSource.EXTERNAL,
    ] = TargetSource.CANOPY
    manual_rate_kg_ha: Rate = 300.0
    # external: so long the other display's is believed
    external_holds_s: Annotated[float, Field(ge=0.5, le=60)] = 2.0
    # external: what is spread while the other display is silent, unless it last wanted
    # nothing; None: 0
    external_silent_kg_ha: Rate | None = None
    # canopy: the field's mean comes to this, the canopy says where; None: the rule says how
    # much as well
    hold_mean_kg_ha: Annotated[float, Field(gt=0, le=2000)] | None = None
    # map_and_canopy: how far the heads may move
    around_percent: Annotated[float, Field(ge=0, le=100)] = 20.0
    around_kg_ha: Rate | None = None  # the same in kg/ha; None: by percent
    decision_hz: Hz = 1.0
    map: str | None = None  # a prescription, next to the job file
    plants: str | None = None  # a plant list, next to the job file
    # canopy: a raster or zones of the crop's index, next to the job file, for where the heads
    # say nothing
    index_map: str | None = None
    # canopy: zones of yield or soil next to the job file, column factor, 0 to 2: times what the
    # rule finds there
    zone_map: str | None = None
    # point mode: one dose, as the paper's
    dose_angle_deg: Annotated[float, Field(ge=0.01, le=3600)] = 120.0
    # the drive's pause between doses, for its report
    dose_rest_s: Annotated[float, Field(ge=0, le=5)] = 0.04
    # point mode: measured dose errors move the threshold
    learn_threshold: bool = True
    # point mode: errors measured before, next to the job: columns error_m (late positive) and
    # speed_mps
    dose_errors: str | None = None

    @model_validator(mode="after")
    def _check_map_named(self) -> Wanted:
        if self.source in MAP_SOURCES and self.map is None:
            raise ValueError(
                f"source {self.source.value} needs the key map: a prescription file next to "
                "the job file"
            )
        if self.hold_mean_kg_ha is not None and self.source is not TargetSource.CANOPY:
            raise ValueError(
                f"hold_mean_kg_ha goes with source canopy, not {self.source.value}: a map "
                "has its own "
                "mean"
            )
        return self


class Nitrogen(FrozenModel):
    """N of this crop on this field, kg of N per ha: what it has, what it gets besides, and how
    much it may get."""

    # since sowing or in this year, by hand or by others: off the optimum of a sufficiency
    # index, and off the ceiling
    given_kg_ha: NRate = 0.0
    # from manure, legumes, soil or water, not in the canopy yet: off what the rule gives; no
    # part of the ceiling
    credit_kg_ha: NRate = 0.0
    # no place of the field gets more in a year, over all passes
    year_max_kg_ha: NRate | None = None
    # when that year began; None: on 1 January of the day of work
    year_from: dt.date | None = None
    # farm record, next to the job: what its passes gave is off the ceiling
    record: str | None = None

    @model_validator(mode="after")
    def _check_ceiling_keys(self) -> Nitrogen:
        idle = [key for key in ("year_from", "record") if getattr(self, key) is not None]
        if idle and self.year_max_kg_ha is None:
            raise ValueError(f"{', '.join(idle)}: goes with year_max_kg_ha")
        return self


class Margin(FrozenModel):
    """Ground along a water or a path that gets nothing: as far as `margin_m` from the line."""

    title: Name = ""
    along_m: Annotated[
        tuple[tuple[CornerOffset, CornerOffset], ...], Field(min_length=2, max_length=MAX_CORNERS)
    ]
    margin_m: Annotated[float, Field(gt=0, le=500)]


class GuidanceLine(FrozenModel):
    """What the tractor is steered along: two places for a straight (AB) line, more for a curve."""

    title: Name = ""
    points_m: Annotated[
        tuple[tuple[CornerOffset, CornerOffset], ...], Field(min_length=2, max_length=MAX_CORNERS)
    ]


class Ground(FrozenModel):
    """A field on its tangent plane: east and north, m, from the origin."""

    title: str = ""
    origin_lat_deg: Annotated[float, Field(ge=-89, le=89)] = 34.28
    origin_lon_deg: Annotated[float, Field(ge=-180, le=180)] = 119.88
    # closed by itself; empty: no field known
    boundary_m: Annotated[
        tuple[tuple[CornerOffset, CornerOffset], ...], Field(max_length=MAX_CORNERS)
    ] = ()
    # ground inside it that is not worked: ponds, trees, masts
    holes_m: Annotated[
        tuple[
            Annotated[
                tuple[tuple[CornerOffset, CornerOffset], ...],
                Field(min_length=3, max_length=MAX_CORNERS),
            ],
            ...,
        ],
        Field(max_length=1000),
    ] = ()
    # that the tractor is steered along
    lines: Annotated[tuple[GuidanceLine, ...], Field(max_length=1000)] = ()
    pass_heading_deg: Annotated[float, Field(ge=0, lt=360)] = 0.0
    # along every edge of the boundary
    headland_m: Annotated[float, Field(ge=0, le=200)] = 0.0
    headland_rate_kg_ha: Rate | None = None  # there; 0: nothing; None: as everywhere
    # ground that others have covered, next to the job: gets no more
    done: str | None = None
    # along chosen edges: nothing lands there
    margins: Annotated[tuple[Margin, ...], Field(max_length=1000)] = ()

    @model_validator(mode="after")
    def _check_polygon(self) -> Ground:
        if self.margins and not self.boundary_m:
            raise ValueError("margins needs boundary_m: the field at whose edges they lie")
        if 0 < len(self.boundary_m) < 3:
            raise ValueError("boundary_m needs at least 3 corners")
        if self.holes_m and not self.boundary_m:
            raise ValueError("holes_m needs boundary_m: the field in which they lie")
        return self

    def make_boundary(self) -> Boundary | None:
        """The field's edge; None where no field is known. Raises ValueError."""
        return Boundary(self.boundary_m, self.holes_m) if self.boundary_m else None

    def make_spread_ground(self, half_width_m: float) -> Boundary | None:
        """Where the middle of what is `2 half_width_m` wide may spread: inside the edge, and
        all of it outside every margin; None where no field is known. Raises ValueError where
        the margins leave nothing."""
        field = self.make_boundary()
        if field is None or not self.margins:
            return field
        left = field.subtract_strips(
            [(margin.along_m, margin.margin_m + half_width_m) for margin in self.margins]
        )
        if left.is_empty:
            raise ValueError("field.margins: leave nothing of the field")
        return left


class Canopy(FrozenModel):
    """A seeded, spatially correlated NDVI field (decision paper: means 0.467-0.546, CV 8-11 %)."""

    mean_ndvi: Annotated[float, Field(ge=0.05, le=0.95)] = 0.52
    cv_percent: Annotated[float, Field(ge=0, le=60)] = 9.5
    correlation_m: Metres = 6.0


class Plants(FrozenModel):
    """A row of plants in the middle of every pass."""

    spacing_m: Annotated[float, Field(ge=0.02, le=10)] = 0.25
    # of the spacing, along the row, 1 s.d.
    scatter_percent: Annotated[float, Field(ge=0, le=50)] = 10.0


class Camera(FrozenModel):
    """Sees plants ahead of the outlet and tells them when its computer is done (point paper:
    1.5 s)."""

    ahead_m: Metres = 6.0  # nearest edge of the picture
    view_m: Metres = 1.0  # length of the picture
    hz: Annotated[float, Field(ge=0.01, le=50)] = 10.0
    computing_s: Annotated[float, Field(ge=0, le=10)] = 1.5
    seen_sd_m: Annotated[float, Field(ge=0, le=1)] = 0.01


class SpeedChange(FrozenModel):
    """From `at_s` on the tractor wants `speed_kmh` (0 stops, negative backs up)."""

    at_s: Annotated[float, Field(ge=0, le=1e7)] = 0.0
    speed_kmh: Annotated[float, Field(ge=-10, le=30)] = 4.5
    acceleration_mps2: Annotated[float, Field(ge=0.001, le=5)] = 0.5


class Simulated(FrozenModel):
    """The ground truth of the simulated machine: tractor, passes, canopy, sensor rates, refills."""

    canopy: Canopy = Canopy()
    speed_kmh: Annotated[float, Field(ge=0.01, le=30)] = 4.5
    speed_wander_percent: Annotated[float, Field(ge=0, le=30)] = 2.0
    speed_changes: Annotated[tuple[SpeedChange, ...], Field(max_length=10_000)] = ()
    # the tractor tells nothing, the speed that its driver has set, changes of that ahead as
    # well, or all of its drive
    speed_told: Literal["none", "set", "plan", "drive"] = "none"
    pass_length_m: Annotated[float, Field(ge=0.1, le=20_000)] = 300.0
    passes: Annotated[int, Field(ge=1, le=1000)] = 24
    run_in_m: Metres = 12.0  # straight beyond each end of a pass
    # of the whole way: where the machine stands at first
    begin_m: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    gnss_hz: Hz = 10.0
    heads_hz: Hz = 2.0
    # what the simulated heads read off the canopy
    heads_index: Literal["ndvi", "ndre"] = "ndvi"
    hopper_kg: Annotated[float, Field(ge=0, le=20000)] = 300.0
    refill_at_kg: Annotated[float, Field(ge=0, le=20000)] = 20.0
    refill_stop_s: Annotated[float, Field(ge=0, le=3600)] = 60.0
    # nose up when heading along pass_heading_deg
    slope_deg: Annotated[float, Field(ge=-20, le=20)] = 0.0
    # pitch and roll wander, 1 s.d.
    roughness_deg: Annotated[float, Field(ge=0, le=10)] = 0.5
    # what the strongest gusts press on the hopper or lift it, three s.d.
    wind_kg: Annotated[float, Field(ge=0, le=500)] = 0.0
    # who steps up on the machine while it stands
    person_kg: Annotated[float, Field(ge=0, le=500)] = 0.0
    # of the scale, 1 s.d. for each m/s of driving
    shaking_kg_per_mps: Annotated[float, Field(ge=0, le=100)] = 0.0
    # the flow of each lot that is filled in lies within as much of the first one's
    lot_percent: Annotated[float, Field(ge=0, le=50)] = 0.0
    # point mode; a plant list of the job stands before it
    plants: Plants | None = None
    camera: Camera | None = None  # point mode without a plant list
    # of dose errors, measured behind the machine
    dose_measured_sd_m: Annotated[float, Field(ge=0, le=1)] = 0.01

    @model_validator(mode="after")
    def _check_plants(self) -> Simulated:
        if (
            self.plants is not None
            and self.passes * self.pass_length_m / self.plants.spacing_m > MAX_PLANTS
        ):
            raise ValueError(
                f"plants.spacing_m {self.plants.spacing_m:g}: {self.passes} passes of "
                f"{self.pass_length_m:g} m have more than {MAX_PLANTS} plants"
            )
        return self


class Job(FrozenModel):
    format: Literal["topdress-job/1"] = "topdress-job/1"
    id: str = "demo"
    title: str = ""
    client: Name = ""
    farm: Name = ""
    operator: Name = ""
    product: Name = ""  # what is spread, as the bag names it
    # the same as a product file: N share, and the flow by its catch tests
    product_file: str | None = None
    # of a kilogram of the product, as bought: costs on the report and in the farm record; None:
    # none are said
    price_per_kg: Annotated[float, Field(ge=0, lt=1e6)] | None = None
    currency: Annotated[str, Field(max_length=8)] = "EUR"  # of that price
    crop: str = "huanghai_wheat"
    # by the crop's day rule; None: the crop file's
    days: Annotated[int, Field(ge=1, le=400)] | None = None
    # with the crop's weather file; None: as that crop file says
    sown: dt.date | None = None
    # the same; None: the crop file's, else the day of work
    sensed: dt.date | None = None
    # on the day of work, on the scale of the crop's growth_window
    growth: GrowthStage | None = None
    ndvi_nrich: Annotated[float, Field(gt=0, le=1)] | None = None
    ndvi_check: Annotated[float, Field(gt=0, le=1)] | None = None  # farmer check
    response_index: ResponseRule | None = None  # None: the crop file's
    strategy: Strategy = Strategy.OPENING_FIRST
    look_ahead: bool = True
    flow_trim: bool = True
    # ground that an earlier pass has covered gets nothing more
    no_double: bool = True
    # of the passes, one for all or a list by pass, the first at the origin; None: nobody has
    # planned it
    planned_speed_kmh: (
        Kmh | Annotated[tuple[Kmh, ...], Field(min_length=1, max_length=1000)] | None
    ) = None
    # share of a section's width that is done, or outside, at which it closes: 0: as soon as any
    # is, 100: once all is
    section_overlap_percent: Annotated[float, Field(ge=0, le=100)] = 50.0
    target: Wanted = Wanted()
    nitrogen: Nitrogen = Nitrogen()
    field: Ground = Ground()
    simulated: Simulated = Simulated()

    @model_validator(mode="after")
    def _check_plants_known(self) -> Job:
        seen = self.simulated.camera is not None and self.simulated.plants is not None
        if self.target.source is TargetSource.POINT and self.target.plants is None and not seen:
            raise ValueError(
                "target.source point needs target.plants: a plant list next to the job file; or, "
                "simulated, simulated.plants and simulated.camera"
            )
        return self

    @model_validator(mode="after")
    def _check_repeated_places(self) -> Job:
        if self.nitrogen.year_max_kg_ha is None:
            return self
        if not self.no_double:
            raise ValueError(
                "no_double false: allowed without nitrogen.year_max_kg_ha, which no place "
                "may pass twice"
            )
        if self.target.plants is not None or self.simulated.camera is not None:
            raise ValueError("nitrogen.year_max_kg_ha: goes with rates; a dose a plant has none")
        return self

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is said of the file though it is right."""
        if self.strategy is self.strategy.in_force:
            return ()
        return (f"strategy {self.strategy}: works as {self.strategy.in_force}",)

    @property
    def named_files(self) -> tuple[str, ...]:
        """Map, plants, index map, zones and done ground, as the job names them, next to its
        file."""
        target = self.target
        return tuple(
            name
            for name in (
                target.map,
                target.plants,
                target.index_map,
                target.zone_map,
                target.dose_errors,
                self.field.done,
            )
            if name is not None
        )

    def rename_files(self, place: Callable[[str], str]) -> Job:
        """The same job, written elsewhere: the files that it names are named anew."""

        def moved(part: FrozenModel, *keys: str) -> dict[str, str]:
            return {key: place(value) for key in keys if (value := getattr(part, key)) is not None}

        return self.model_copy(
            update={
                "target": self.target.model_copy(
                    update=moved(
                        self.target, "map", "plants", "index_map", "zone_map", "dose_errors"
                    )
                ),
                "nitrogen": self.nitrogen.model_copy(update=moved(self.nitrogen, "record")),
                "field": self.field.model_copy(update=moved(self.field, "done")),
            }
        )


def make_rule(crop: Crop, job: Job, days: int | None = None) -> Rule:
    """The rule of a job's crop. days: as counted, where the job says none. Raises ValueError as
    `prepare_rule` does."""
    return prepare_rule(
        crop,
        job.days or days,
        job.ndvi_nrich,
        job.ndvi_check,
        job.response_index,
        job.nitrogen.given_kg_ha,
        job.nitrogen.credit_kg_ha,
    )
