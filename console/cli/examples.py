"""Examples that stand under each command's help. A test parses every one of them."""
from __future__ import annotations

EXAMPLES: dict[str, tuple[str, ...]] = {
    "run": ("topdress run", "topdress run --config job.yaml --config cab.yaml", "topdress run --effect shaft.gain=-6"),
    "replay": ("topdress replay run.csv", "topdress replay run.csv --headless --out again.csv --strategy speed_first"),
    "simulate": ("topdress simulate --summary",
                 "topdress simulate --seconds 3600 --out run.csv --effect shaft.gain=-6"),
    "diagnose": ("topdress diagnose run.csv", "topdress diagnose run.csv --report why.html --adopt mended.yaml",
                 "topdress diagnose lag.csv catch.csv --machine huanghai"),
    "compare": ("topdress compare huanghai mended.yaml other-day.csv",
                "topdress compare old.yaml new.yaml a.csv b.csv --report compared.html"),
    "watch": ("topdress watch run.csv", "topdress watch planter.csv --machine planter --to-end"),
    "fleet": ("topdress fleet season --out report --price 2.8",
              "topdress fleet s3://farm/logs/*.parquet --out report --scheduler tcp://barn:8786"),
    "history": ("topdress history mended.yaml", "topdress history mended.yaml --undo --out before.yaml"),
    "machine": ("topdress machine --from pump.csv --out my-pump.yaml --kind pump",
                "topdress machine --from wheel.csv --out left.yaml --full-speed 650 --both-ways --noise 2 --running"),
    "calibrate catch": ("topdress calibrate catch weighed.csv --out mine.yaml",),
    "calibrate lag": ("topdress calibrate lag drops.csv --out mine.yaml --from-rpm 20 --to-rpm 60",
                      "topdress calibrate lag --rig COM5 --board COM4 --out drops.csv"),
    "calibrate wheel": ("topdress calibrate wheel run.csv --out mine.yaml",),
    "calibrate heads": ("topdress calibrate heads run.csv --out mine.yaml",),
    "info": ("topdress info", "topdress info --json"),
    "extras": ("topdress extras",),
    "effects": ("topdress effects", "topdress effects --json"),
    "decode": ("topdress decode gnss receiver.bin", "topdress decode board board.bin --json"),
    "import": ("topdress import yield.csv --guess --mapping yield.import.yaml",
               "topdress import yield.csv --mapping yield.import.yaml --out yield-log.csv"),
    "map": ("topdress map field.shp", "topdress map field.shp --column RATE --unit lb/ac --out task.zip",
            "topdress map run.csv --out sheet.html"),
    "field": ("topdress field ~/Documents/AgOpenGPS/Fields/North --job demo --out north.yaml",
              "topdress field north.kml --out north.geojson", "topdress field north.yaml --out north"),
    "record": ("topdress record run.csv --out farm.csv", "topdress record *.csv --price urea=0.42 --currency EUR"),
    "reproduce": ("topdress reproduce --out papers",),
    "check": ("topdress check job.yaml cab.yaml", "topdress check --schema machine"),
    "devices": ("topdress devices",),
    "serve": ("topdress serve",),
    "serve-machine": ("topdress serve-machine --port 4100",),
}
ENDS = """Exit codes: 0 done; 1 a disk, port or line failed; 2 what was given is wrong; 3 nothing of the data could be
judged; 70 a fault of topdress itself; 130 cancelled. Words are completed by the tab key after: topdress
--install-completion."""


def under(name: str) -> str:
    """What stands below a command's help; each example on a line of its own."""
    return "\b\nExamples:\n" + "\n".join(f"  {line}" for line in EXAMPLES[name])
