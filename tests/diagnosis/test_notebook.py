"""What a notebook hands over and gets back: tables of any library, one clear line for what is
wrong, pictures."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pytest
from topdress.control.diagnosis import compared, diagnose_run
from topdress.control.diagnosis.dataframe_input import read_columns
from topdress.control.diagnosis.result import Diagnosis
from topdress.control.machine.machine import Machine

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "notebook.md"
TIME = np.arange(0.0, 5.0, 0.1)
PLAIN = {"time_s": TIME, "shaft_rpm_cmd": 100.0 + TIME, "shaft_rpm": 101.0 + TIME}
DAY = np.datetime64("2026-03-20T08:00:00", "ns") + (1e9 * TIME).astype("timedelta64[ns]")
REST = {name: values for name, values in PLAIN.items() if name != "time_s"}


@pytest.mark.parametrize(
    "data",
    [
        PLAIN,
        {name: list(values) for name, values in PLAIN.items()},
        pd.DataFrame(PLAIN),
        pl.DataFrame(PLAIN),
        pd.DataFrame(PLAIN).convert_dtypes(),
        pd.DataFrame(PLAIN).to_records(index=False),
        pd.DataFrame(PLAIN).to_dict("records"),
        {name: pd.Series(values) for name, values in PLAIN.items()},
        {"time_ms": (1000.0 * TIME).round(), **REST},
        pd.DataFrame({"timestamp": DAY, **REST}),
        pd.DataFrame(REST, index=DAY),
        {"utc": [f"{one}Z" for one in DAY.astype("datetime64[ms]")], **REST},
        {"time_s": DAY, **REST},
        {**PLAIN, "note": [""] * 50, "nothing": [None] * 50},
        {**PLAIN, "remark": ["warm"] * 50},
        {**{name: values.astype(object) for name, values in PLAIN.items()}},
        {**PLAIN, "shaft_rpm": np.ma.masked_array(PLAIN["shaft_rpm"], [False] * 50)},
    ],
    ids=range(17),
)
def test_any_table_is_the_same_log(data: Any) -> None:
    found = read_columns(data)
    assert set(found) - {"remark"} == set(PLAIN)
    for name, values in PLAIN.items():
        assert found[name].dtype == np.float64 and np.allclose(found[name], values, atol=1e-6), name


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (
            {**PLAIN, "shaft_rpm": [1.0]},
            "column shaft_rpm: 1 rows where time_s has 50: allowed is one length for all",
        ),
        (
            {**PLAIN, "shaft_rpm": ["fast"] * 50},
            "column shaft_rpm: row 0: value 'fast': allowed is a number",
        ),
        ({**PLAIN, "shaft_rpm": np.zeros((50, 2))}, "column shaft_rpm: shape (50, 2)"),
        ({**PLAIN, "shaft_rpm": 3.0}, "column shaft_rpm: value 3.0: allowed is a column"),
        (REST, "column time_s: missing: a run log needs it; allowed in its place: time_ms"),
        (
            {**PLAIN, "time_s": ["yesterday"] * 50},
            "column time_s: row 0: value 'yesterday': allowed are seconds, or ISO",
        ),
        ({}, "no columns in the data"),
        (np.zeros((50, 3)), "an array of shape (50, 3) has no names"),
        ({name: [] for name in PLAIN}, "column time_s: no rows"),
        (7, "a int has no names"),
        (pd.DataFrame(np.zeros((50, 2)), columns=["a", "a"]), "column a: stands twice"),
    ],
    ids=range(11),
)
def test_what_is_wrong_is_one_clear_line(data: Any, said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)) as caught:
        diagnose_run(data, "drive_alone")
    assert "\n" not in str(caught.value)


def test_a_machine_is_named_or_refused() -> None:
    with pytest.raises(ValueError, match="drive_alon: no configuration of this name") as caught:
        diagnose_run(PLAIN, "drive_alon")
    assert "\n" not in str(caught.value)


@pytest.mark.exam
def test_the_page_ends_with_a_model_that_predicts_better(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its blocks one after the other, as a reader runs them."""
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    text = PAGE.read_text(encoding="utf-8")
    for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
        exec(compile(block, str(PAGE), "exec"), names)
    shaft = names["shaft"]
    causes = {cause.id: cause.size.value for cause in names["found"].causes}
    told = re.search(r"From (\d+) to ([\d.]+) r/min", text)
    slower = re.search(r"turns (\d+) % slower", text)
    assert told and slower and set(causes) == {"shaft.gain", "shaft.slow"}
    assert float(told[1]) == pytest.approx(shaft.old, rel=0.05)
    assert float(told[2]) == pytest.approx(shaft.new, rel=0.05)
    assert -float(slower[1]) == pytest.approx(causes["shaft.gain"], abs=0.5)
    assert shaft.new < 0.1 * shaft.old and shaft.low > 0.0, capsys.readouterr().out
    assert (tmp_path / "fan-extended.yaml").exists()
    pictures, found = names["pictures"], names["found"]
    assert len(pictures.svgs) >= 2 and all("<svg" in one for one in pictures.svgs)
    assert "<svg" in pictures.save(tmp_path / "why.html").read_text(encoding="utf-8")
    shown = found._repr_html_()
    assert "shaft" in shown and "<table" in shown and "<script" not in shown
    assert "seen_with" not in json.dumps(found.to_json())
    bare = Diagnosis(
        **{one: getattr(found, one) for one in Diagnosis.__slots__ if one != "seen_with"}
    )
    assert bare == found
    with pytest.raises(ValueError, match="is not with it"):
        bare.plot()


def a_log() -> dict[str, np.ndarray]:
    rng, time_s = np.random.default_rng(1), np.arange(0.0, 120.0, 0.1)
    command = np.where(time_s % 20.0 < 10.0, 40.0, 60.0)
    read = 1.04 * np.roll(command, 4) + 0.3 * rng.standard_normal(1200)
    supply = np.full(1200, 13.5)
    return {"time_s": time_s, "shaft_rpm_cmd": command, "shaft_rpm": read, "supply_v": supply}


def test_a_diagnosis_is_printed_in_fifteen_lines_and_goes_on_as_a_frame_of_the_same_library() -> (
    None
):
    found = {
        name: diagnose_run(frame(a_log()), Machine())
        for name, frame in (("pandas", pd.DataFrame), ("polars", pl.DataFrame), ("", dict))
    }
    text = str(found["pandas"])
    assert text == found[""].summary() and 1 < len(text.splitlines()) <= 15
    assert "shaft.gain" in text and "shaft_rpm_cmd" not in text
    for name, library in (("pandas", pd), ("polars", pl), ("", pd)):
        causes, left = found[name].to_frame(), found[name].residuals()
        assert isinstance(causes, library.DataFrame) and isinstance(left, library.DataFrame)
        assert list(causes["id"]) == [one.id for one in found[name].causes]
        residual = np.asarray(left["measured"]) - np.asarray(left["predicted"])
        assert np.asarray(left["residual"]) == pytest.approx(residual)
    assert "frame_library" not in json.dumps(found["pandas"].to_json())


def test_a_picture_may_be_styled_anew() -> None:
    pictures = diagnose_run(a_log(), Machine()).plot()
    pictures[0].panel.title = "of Monday"
    assert len(pictures) == len(pictures.svgs) and "of Monday" in pictures.svgs[0]
    assert "of Monday" in pictures._repr_html_()


def test_a_misspelt_column_is_a_note_with_the_nearest_name() -> None:
    log = a_log()
    log["shaft_rmp"] = log.pop("shaft_rpm")
    found = diagnose_run(log | {"speed_mps": np.ones(1200)}, Machine())
    assert any("shaft_rmp" in one and "did you mean shaft_rpm?" in one for one in found.findings)
    assert not any("did you mean" in one for one in diagnose_run(a_log(), Machine()).findings)


def test_a_comparison_is_printed_a_line_each_channel() -> None:
    result = compared(a_log(), Machine(), Machine())
    assert "shaft: error " in str(result) and "array" not in str(result)
    assert "<svg" in result._repr_html_()
