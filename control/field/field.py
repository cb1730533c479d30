"""A field as a configuration file gives it: origin, corners in metres or degrees, headland."""
from __future__ import annotations

from functools import cached_property
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, model_validator
from pydantic import Field as Key

from control.field.boundary import Boundary
from control.geodesy import Place, TangentPlane

Latitude = Annotated[float, Key(ge=-90.0, le=90.0)]
Longitude = Annotated[float, Key(ge=-180.0, le=180.0)]
RingM = tuple[tuple[float, float], ...]
RingDeg = tuple[tuple[Latitude, Longitude], ...]

LARGEST_M = 20_000.0


class Origin(BaseModel):
    """Where the field's tangent plane touches the earth, WGS84."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    lat_deg: Latitude
    lon_deg: Longitude


class Field(BaseModel):
    """Corners either in metres from the origin (`boundary_m`: east, north) or in degrees (`boundary_deg`: latitude
    first). Without an origin the first corner in degrees is it. Rings close by themselves.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: str = ""
    origin: Origin | None = None
    boundary_m: RingM = ()
    boundary_deg: RingDeg = ()
    holes_m: tuple[RingM, ...] = ()
    holes_deg: tuple[RingDeg, ...] = ()
    headland_m: float = Key(default=0.0, ge=0.0, le=200.0)

    @model_validator(mode="after")
    def _one_field(self) -> Self:
        if bool(self.boundary_m) == bool(self.boundary_deg):
            raise ValueError("allowed is one of boundary_m (east, north in m) and boundary_deg (latitude, longitude)")
        if self.boundary_m and self.origin is None:
            raise ValueError("origin missing: boundary_m is counted from it")
        if (self.holes_deg and self.boundary_m) or (self.holes_m and self.boundary_deg):
            raise ValueError("holes are written as the boundary is: both in m, or both in degrees")
        farthest = max((max(abs(east), abs(north)) for east, north in self._rings()[0]), default=0.0)
        if farthest > LARGEST_M:
            raise ValueError(f"a corner {farthest / 1000:.1f} km from the origin: allowed is {LARGEST_M / 1000:g} km "
                             "(are latitude and longitude swapped?)")
        if self.boundary.inset(self.headland_m).is_empty:
            raise ValueError(f"headland_m {self.headland_m:g}: leaves nothing of the field")
        return self

    @cached_property
    def plane(self) -> TangentPlane:
        if self.origin is not None:
            return TangentPlane(self.origin.lat_deg, self.origin.lon_deg)
        return TangentPlane(*self.boundary_deg[0])

    @cached_property
    def boundary(self) -> Boundary:
        outline, *holes = self._rings()
        return Boundary(outline, holes)

    def _rings(self) -> tuple[tuple[Place, ...], ...]:
        if self.boundary_m:
            return (self.boundary_m, *self.holes_m)
        return tuple(tuple(self.plane.to_m(lat, lon) for lat, lon in ring)
                     for ring in (self.boundary_deg, *self.holes_deg))
