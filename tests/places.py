"""Where the tests' data lie: facts of the papers and public recordings; tests/data/README.md
says whose they are."""

from pathlib import Path

DATA = Path(__file__).parent / "data"
PAPERS = DATA / "papers"  # tables of the three papers
RECEIVERS = DATA / "nmea"  # recordings of GNSS receivers
TASK_FILES = DATA / "isoxml"
DRIVES = DATA / "drives"  # recordings of small motors and a heater
