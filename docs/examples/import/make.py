"""Writes the three files that docs/import.md brings in: made up, with oddities of real ones.

python docs/examples/import/make.py [FOLDER]
"""

from __future__ import annotations

import datetime as dt
import json
import sys
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np

HERE = Path(__file__).parent


def followed(command: Any, share: float) -> Any:
    """What follows a command, first order, one row late."""
    out = np.array(command, dtype=float)
    for k in range(1, len(out)):
        out[k] = out[k - 1] + share * (command[k - 1] - out[k - 1])
    return out


def track(
    speed_mps: Any, step_s: float, lat: float, lon: float, heading_deg: float
) -> tuple[Any, Any]:
    way_m = np.cumsum(speed_mps) * step_s
    heading = np.radians(heading_deg)
    return (
        lat + way_m * np.cos(heading) / 111_200.0,
        lon + way_m * np.sin(heading) / (111_200.0 * np.cos(np.radians(lat))),
    )


def planter() -> bytes:
    """A German planter's fertilizer unit: titles, a row of units, decimal commas, local time,
    signs for not known."""
    rng, rows, step = np.random.default_rng(1), 240, 0.5
    t = np.arange(rows) * step
    speed = 2.0 + 0.3 * np.sin(t / 9.0)
    lat, lon = track(speed, step, 48.41, 10.02, 70.0)
    down = (t > 6.0) & (t < 112.0)
    wanted = np.where(down, np.repeat(rng.uniform(25.0, 60.0, rows // 12), 12), 0.0)
    shaft = np.maximum(followed(wanted, 0.7) + rng.normal(0.0, 0.2, rows), 0.0)
    slide = np.repeat(rng.uniform(30.0, 80.0, rows // 40), 40)
    weight = 410.0 - np.cumsum(shaft * slide) * 2e-4 + rng.normal(0.0, 0.1, rows)
    begin = dt.datetime(2026, 4, 14, 9, 30, tzinfo=ZoneInfo("Europe/Berlin"))
    lines = [
        "Protokoll Düngeeinheit;;;;;;;;",
        "Fahrer: Jörg Müller; Schlag: Hohe Breite;;;;;;;",
        "Zeit;Breitengrad;Längengrad;Geschwindigkeit;Drehzahl Soll;Drehzahl "
        "Ist;Schieberöffnung;Behältergewicht;"
        "Arbeitsstellung",
        ";[°];[°];[km/h];[U/min];[U/min];[%];[kg];",
    ]
    for k in range(rows):
        moment = begin + dt.timedelta(seconds=float(t[k]))
        weighed = "65535" if rng.random() < 0.03 else f"{weight[k]:.1f}"
        turned = "-9999" if rng.random() < 0.02 else f"{shaft[k]:.1f}"
        cells = [
            f"{lat[k]:.7f}",
            f"{lon[k]:.7f}",
            f"{3.6 * speed[k]:.2f}",
            f"{wanted[k]:.1f}",
            turned,
            f"{slide[k]:.1f}",
            weighed,
            str(int(down[k])),
        ]
        stamp = f"{moment:%d.%m.%Y %H:%M:%S}.{moment.microsecond // 100_000}"
        lines.append(f"{stamp};" + ";".join(cells).replace(".", ","))
    return ("\r\n".join(lines) + "\r\n").encode("latin-1")


def tractor() -> bytes:
    """A Chinese tractor's bus log in GBK: units in the header's wide brackets, milliseconds
    since 1970."""
    rng, rows, step = np.random.default_rng(2), 400, 0.1
    t = np.arange(rows) * step
    torque = 280.0 + 60.0 * np.sin(t / 7.0) + rng.normal(0.0, 6.0, rows)
    speed = 1.6 + 0.2 * np.sin(t / 5.0)
    wheel = speed * (1.0 + 0.0002 * torque) + rng.normal(0.0, 0.004, rows)
    lat, lon = track(speed, step, 34.28, 119.88, 12.0)
    begin = round(dt.datetime(2026, 3, 20, 0, 15, tzinfo=dt.UTC).timestamp() * 1000)
    lines = [
        "时间,纬度,经度,车速（km/h）,轮速（km/h）,发动机转速（r/min）,发动机扭矩（N·m）,电压（V）"
    ]
    for k in range(rows):
        twist = "65535" if rng.random() < 0.02 else f"{torque[k]:.0f}"
        lines.append(
            f"{begin + round(1000 * t[k])},{lat[k]:.8f},{lon[k]:.8f},{3.6 * speed[k]:.3f},"
            f"{3.6 * wheel[k]:.3f},"
            f"{1500 + 0.5 * torque[k]:.0f},{twist},{13.8 + rng.normal(0.0, 0.05):.2f}"
        )
    return ("\n".join(lines) + "\n").encode("gbk")


def applied() -> bytes:
    """An American as-applied file: points, pounds an acre, times of twelve hours, nothing of
    the zone."""
    rng, rows = np.random.default_rng(3), 200
    t = np.arange(rows) * 1.0
    speed = 3.1 + 0.2 * np.sin(t / 11.0)
    lat, lon = track(speed, 1.0, 41.62, -93.51, 180.0)
    target = np.repeat(rng.choice([120.0, 150.0, 180.0, 210.0], rows // 20), 20)
    rate = followed(target, 0.55) + rng.normal(0.0, 1.5, rows)
    begin = dt.datetime(2026, 4, 22, 12, 58, 30)
    features = []
    for k in range(rows):
        moment = begin + dt.timedelta(seconds=float(t[k]))
        place = {"type": "Point", "coordinates": [round(lon[k], 7), round(lat[k], 7)]}
        values = {
            "Time": f"{moment:%m/%d/%Y %I:%M:%S %p}",
            "Speed(mph)": round(2.2369 * speed[k], 2),
            "Target Rate(lb/ac)": float(target[k]),
            "Applied Rate(lb/ac)": round(rate[k], 1),
            "Elevation(ft)": round(912.0 + 3.0 * np.sin(t[k] / 40.0), 1),
        }
        features.append({"type": "Feature", "geometry": place, "properties": values})
    return (
        json.dumps({"type": "FeatureCollection", "features": features}, indent=None) + "\n"
    ).encode()


FILES = {"planter.csv": planter, "tractor.csv": tractor, "applied.geojson": applied}


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE
    for name, made in FILES.items():
        (folder / name).write_bytes(made())


if __name__ == "__main__":
    main()
