"""Defines the job file: the work, its field and strategy, and the ground of the simulated
machine.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable
from typing import Annotated, Literal

from pydantic import Field, model_validator
from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.growth_stage import GrowthStage
from topdress.control.agronomy.nitrogen_rate import CropRule, prepare_rule
from topdress.control.agronomy.nitrogen_response import ResponseRule
from topdress.control.field.boundary import Boundary
from topdress.control.frozen_model import FrozenModel
from topdress.control.orders import MAP_SOURCES, Strategy, TargetSource

Rate = Annotated[float, Field(ge=0, le=2000)]
Metres = Annotated[float, Field(ge=0.01, le=1000)]
# Nitrogen rate, kg/ha of N, not of product.
NRate = Annotated[float, Field(ge=0, le=1000)]
# Offset of a corner from the field's origin, m.
CornerOffset = Annotated[float, Field(ge=-100_000, le=100_000)]
Hz = Annotated[float, Field(ge=0.01, le=20)]
MAX_CORNERS = 20_000
# Maximum number of plants, as in a plant list.
MAX_PLANTS = 1_000_000
Kmh = Annotated[float, Field(gt=0, le=30)]
Name = Annotated[str, Field(max_length=80)]


class Wanted(FrozenModel):
    """Source of the target."""

    source: Literal[
        TargetSource.CANOPY,
        TargetSource.MAP,
        TargetSource.POINT,
        TargetSource.MANUAL,
        TargetSource.MAP_AND_CANOPY,
        TargetSource.EXTERNAL,
    ] = TargetSource.CANOPY
    manual_rate_kg_ha: Rate = 300.0
    # Source external: validity of a target of the other display, s.
    external_holds_s: Annotated[float, Field(ge=0.5, le=60)] = 2.0
    # Source external: rate while the other display is silent, unless its last target was zero; None
    # means 0.
    external_silent_kg_ha: Rate | None = None
    # Source canopy: mean rate of the field, with the canopy deciding the distribution; None means
    # that the rule also decides the amount.
    hold_mean_kg_ha: Annotated[float, Field(gt=0, le=2000)] | None = None
    # Source map_and_canopy: permitted deviation of the heads from the map, %.
    around_percent: Annotated[float, Field(ge=0, le=100)] = 20.0
    # Permitted deviation in kg/ha; None means by percent.
    around_kg_ha: Rate | None = None
    decision_hz: Hz = 1.0
    # Path of a prescription, relative to the job file.
    map: str | None = None
    # Path of a plant list, relative to the job file.
    plants: str | None = None
    # Source canopy: path of a raster or of zones of the crop's index, relative to the job file, for
    # silent heads.
    index_map: str | None = None
    # Source canopy: path of zones of yield or soil, relative to the job file, with a column factor,
    # 0 to 2, that multiplies the rule's rate.
    zone_map: str | None = None
    # Point mode: angle of a dose, degrees, as in the paper.
    dose_angle_deg: Annotated[float, Field(ge=0.01, le=3600)] = 120.0
    # Pause of the drive between doses for its report, s.
    dose_rest_s: Annotated[float, Field(ge=0, le=5)] = 0.04
    # Point mode: whether measured dose errors change the threshold.
    learn_threshold: bool = True
    # Point mode: path of earlier measured errors, relative to the job file: columns error_m (late
    # positive) and speed_mps.
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
    """Nitrogen of this crop on this field, kg of N per ha: applied, credited from other sources,
    and permitted."""

    # Applied since sowing or in this year, by hand or by others: subtracted from the optimum of a
    # sufficiency index, and from the ceiling.
    given_kg_ha: NRate = 0.0
    # Credit from manure, legumes, soil or water that the canopy does not show yet: subtracted from
    # the rule's rate, not from the ceiling.
    credit_kg_ha: NRate = 0.0
    # Maximum of a year for any position of the field, over all passes.
    year_max_kg_ha: NRate | None = None
    # Start of that year; None means 1 January of the day of work.
    year_from: dt.date | None = None
    # Path of a farm record, relative to the job file: its passes are subtracted from the ceiling.
    record: str | None = None

    @model_validator(mode="after")
    def _check_ceiling_keys(self) -> Nitrogen:
        idle = [key for key in ("year_from", "record") if getattr(self, key) is not None]
        if idle and self.year_max_kg_ha is None:
            raise ValueError(f"{', '.join(idle)}: goes with year_max_kg_ha")
        return self


class Margin(FrozenModel):
    """Ground along a water or a path that gets no material, up to `margin_m` from the line."""

    title: Name = ""
    along_m: Annotated[
        tuple[tuple[CornerOffset, CornerOffset], ...], Field(min_length=2, max_length=MAX_CORNERS)
    ]
    margin_m: Annotated[float, Field(gt=0, le=500)]


class GuidanceLine(FrozenModel):
    """Guidance line of the tractor: two positions for a straight (AB) line, more for a curve."""

    title: Name = ""
    points_m: Annotated[
        tuple[tuple[CornerOffset, CornerOffset], ...], Field(min_length=2, max_length=MAX_CORNERS)
    ]


class Ground(FrozenModel):
    """A field on its tangent plane: east and north, m, from the origin."""

    title: str = ""
    origin_lat_deg: Annotated[float, Field(ge=-89, le=89)] = 34.28
    origin_lon_deg: Annotated[float, Field(ge=-180, le=180)] = 119.88
    # Outline, closed automatically; empty for an unknown field.
    boundary_m: Annotated[
        tuple[tuple[CornerOffset, CornerOffset], ...], Field(max_length=MAX_CORNERS)
    ] = ()
    # Ground inside the outline that is not worked: ponds, trees, masts.
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
    # Guidance lines of the tractor.
    lines: Annotated[tuple[GuidanceLine, ...], Field(max_length=1000)] = ()
    pass_heading_deg: Annotated[float, Field(ge=0, lt=360)] = 0.0
    # Width of the headland along every edge of the boundary, m.
    headland_m: Annotated[float, Field(ge=0, le=200)] = 0.0
    # Rate on the headland; 0 for no material, None for the same rate as elsewhere.
    headland_rate_kg_ha: Rate | None = None
    # Path of ground that others have covered, relative to the job file, which gets no more
    # material.
    done: str | None = None
    # Strips along chosen edges that get no material.
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
        """Return the field's edge; None for an unknown field. Raises ValueError."""
        return Boundary(self.boundary_m, self.holes_m) if self.boundary_m else None

    def make_spread_ground(self, half_width_m: float) -> Boundary | None:
        """Return the ground on which the middle of a spread of width `2 half_width_m` may be:
        inside the edge, and with its whole width outside every margin.

        The result is None for an unknown field. Raises ValueError where the margins leave no
        ground.
        """
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
    """A random, spatially correlated NDVI field with a seed (decision paper: means 0.467-0.546,
    CV 8-11 %)."""

    mean_ndvi: Annotated[float, Field(ge=0.05, le=0.95)] = 0.52
    cv_percent: Annotated[float, Field(ge=0, le=60)] = 9.5
    correlation_m: Metres = 6.0


class Plants(FrozenModel):
    """A row of plants in the middle of every pass."""

    spacing_m: Annotated[float, Field(ge=0.02, le=10)] = 0.25
    # Standard deviation of the position along the row, as a share of the spacing.
    scatter_percent: Annotated[float, Field(ge=0, le=50)] = 10.0


class Camera(FrozenModel):
    """Camera that sees plants ahead of the outlet and reports them after its computing time
    (point paper: 1.5 s)."""

    # Distance of the near edge of the picture, m.
    ahead_m: Metres = 6.0
    # Length of the picture, m.
    view_m: Metres = 1.0
    hz: Annotated[float, Field(ge=0.01, le=50)] = 10.0
    computing_s: Annotated[float, Field(ge=0, le=10)] = 1.5
    seen_sd_m: Annotated[float, Field(ge=0, le=1)] = 0.01


class SpeedChange(FrozenModel):
    """Change of speed: from `at_s` on the tractor's target is `speed_kmh` (0 stops, negative
    reverses)."""

    at_s: Annotated[float, Field(ge=0, le=1e7)] = 0.0
    speed_kmh: Annotated[float, Field(ge=-10, le=30)] = 4.5
    acceleration_mps2: Annotated[float, Field(ge=0.001, le=5)] = 0.5


class Simulated(FrozenModel):
    """Ground truth of the simulated machine: tractor, passes, canopy, sensor rates, refills."""

    canopy: Canopy = Canopy()
    speed_kmh: Annotated[float, Field(ge=0.01, le=30)] = 4.5
    speed_wander_percent: Annotated[float, Field(ge=0, le=30)] = 2.0
    speed_changes: Annotated[tuple[SpeedChange, ...], Field(max_length=10_000)] = ()
    # Announcement of the tractor: none, the speed that its driver has set, future changes of that
    # speed as well, or its whole drive.
    speed_told: Literal["none", "set", "plan", "drive"] = "none"
    pass_length_m: Annotated[float, Field(ge=0.1, le=20_000)] = 300.0
    passes: Annotated[int, Field(ge=1, le=1000)] = 24
    # Straight distance beyond each end of a pass, m.
    run_in_m: Metres = 12.0
    # Start position of the machine along the whole path, m.
    begin_m: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    gnss_hz: Hz = 10.0
    heads_hz: Hz = 2.0
    # Index that the simulated heads read.
    heads_index: Literal["ndvi", "ndre"] = "ndvi"
    hopper_kg: Annotated[float, Field(ge=0, le=20000)] = 300.0
    refill_at_kg: Annotated[float, Field(ge=0, le=20000)] = 20.0
    refill_stop_s: Annotated[float, Field(ge=0, le=3600)] = 60.0
    # Upward pitch when heading along pass_heading_deg, degrees.
    slope_deg: Annotated[float, Field(ge=-20, le=20)] = 0.0
    # Standard deviation of pitch and roll, degrees.
    roughness_deg: Annotated[float, Field(ge=0, le=10)] = 0.5
    # Load of the strongest gusts on the hopper, three standard deviations, kg.
    wind_kg: Annotated[float, Field(ge=0, le=500)] = 0.0
    # Mass of a person who steps on the standing machine, kg.
    person_kg: Annotated[float, Field(ge=0, le=500)] = 0.0
    # Standard deviation of the scale for each m/s of speed, kg.
    shaking_kg_per_mps: Annotated[float, Field(ge=0, le=100)] = 0.0
    # Variation of the flow between lots, relative to the first lot, %.
    lot_percent: Annotated[float, Field(ge=0, le=50)] = 0.0
    # Plants of point mode; the job's plant list takes precedence.
    plants: Plants | None = None
    # Camera of point mode without a plant list.
    camera: Camera | None = None
    # Standard deviation of dose errors measured behind the machine, m.
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
    """Job file "topdress-job/1"."""

    format: Literal["topdress-job/1"] = "topdress-job/1"
    id: str = "demo"
    title: str = ""
    client: Name = ""
    farm: Name = ""
    operator: Name = ""
    # Product, as named on the bag.
    product: Name = ""
    # Product file with the N share, and the flow by its catch tests.
    product_file: str | None = None
    # Purchase price per kilogram of product, for the costs on the report and in the farm record;
    # None for no costs.
    price_per_kg: Annotated[float, Field(ge=0, lt=1e6)] | None = None
    # Currency of the price.
    currency: Annotated[str, Field(max_length=8)] = "EUR"
    crop: str = "huanghai_wheat"
    # Growing days by the crop's day rule; None means those of the crop file.
    days: Annotated[int, Field(ge=1, le=400)] | None = None
    # Date of sowing, for the crop's weather file; None means that of the crop file.
    sown: dt.date | None = None
    # Date of sensing; None means that of the crop file, or else the day of work.
    sensed: dt.date | None = None
    # Growth stage on the day of work, on the scale of the crop's growth_window.
    growth: GrowthStage | None = None
    ndvi_nrich: Annotated[float, Field(gt=0, le=1)] | None = None
    # NDVI of the farmer check.
    ndvi_check: Annotated[float, Field(gt=0, le=1)] | None = None
    # None means the rule of the crop file.
    response_index: ResponseRule | None = None
    strategy: Strategy = Strategy.OPENING_FIRST
    look_ahead: bool = True
    flow_trim: bool = True
    # Whether ground that an earlier pass has covered gets no more material.
    no_double: bool = True
    # Planned speed of the passes: a single speed or a list by pass, the first at the origin; None
    # for no plan.
    planned_speed_kmh: (
        Kmh | Annotated[tuple[Kmh, ...], Field(min_length=1, max_length=1000)] | None
    ) = None
    # Share of a section's width over done or outside ground at which the section closes, %: 0 for
    # any share, 100 for the whole width.
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
        """Return warnings about a valid file."""
        if self.strategy is self.strategy.in_force:
            return ()
        return (f"strategy {self.strategy}: works as {self.strategy.in_force}",)

    @property
    def named_files(self) -> tuple[str, ...]:
        """Return the files that the job names relative to its own: map, plants, index map, zones
        and done ground."""
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
        """Return the job with new names of its files, for another folder."""

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


def make_rule(crop: Crop, job: Job, days: int | None = None) -> CropRule:
    """Return the rule of a job's crop. days: counted growing days, used where the job has none.
    Raises ValueError as `prepare_rule` does."""
    return prepare_rule(
        crop,
        job.days or days,
        job.ndvi_nrich,
        job.ndvi_check,
        job.response_index,
        job.nitrogen.given_kg_ha,
        job.nitrogen.credit_kg_ha,
    )
