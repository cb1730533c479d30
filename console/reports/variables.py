"""Recorded variables and settings in plain words, with their units."""
from __future__ import annotations

OF_RUNS = {"shaft_rpm": "shaft speed commanded, r/min", "opening_mm": "opening commanded, mm", "supply_v": "supply, V",
           "pitch_deg": "pitch, degrees nose up", "roll_deg": "roll, degrees right side down",
           "hopper_kg": "hopper, kg", "speed_mps": "ground speed, m/s", "heading_deg": "heading, degrees",
           "time_s": "time, min"}
OF_TABLES = {"shaft_rpm": "shaft speed, r/min", "opening_mm": "opening, mm", "duration_s": "duration, s",
             "speed_mps": "ground speed, m/s", "target_kg": "target, kg", "area_m2": "area, m2", "outlet": "outlet",
             "ndvi_reference": "NDVI of the reference", "head": "head", "warm_min": "minutes since switched on",
             "height_m": "height, m", "corrected_lag_s": "lag corrected for, s",
             "before_rpm": "shaft speed before, r/min", "replicate": "replicate",
             "label": "label", "constant": "a constant"}


def plain(name: str, kind: str = "run") -> str:
    """The variable without its unit; its own name where it is not known."""
    return (OF_RUNS if kind == "run" else OF_TABLES).get(name, name).split(",")[0]
