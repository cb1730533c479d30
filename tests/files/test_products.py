"""The product library: apart from machine and crop, named by the job; its flow and its N share
come with it."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import pytest
from pydantic import ValidationError
from topdress.console.app.pages.job.checklist import LOOK, OK, list_checks
from topdress.console.app.units import METRIC
from topdress.console.services.job import JobFiles, Launcher
from topdress.control.agronomy.product import CatchTest, Product
from topdress.control.field.job_names import JobNames
from topdress.control.machine.product_calibration import apply_product
from topdress.drivers.files.config import find_shipped_files, load_config, save_config
from topdress.drivers.files.config_error import ConfigError
from topdress.drivers.files.config_kinds import JOB_KIND, MACHINE_KIND, PRODUCT_KIND
from topdress.drivers.files.run_setup import describe_product, load_setup

from tests.command import topdress

TODAY = dt.date(2026, 3, 18)


def prills(*tests: CatchTest) -> Product:
    return load_config("urea_prilled", PRODUCT_KIND).model.model_copy(update={"catch_tests": tests})


def caught(grams: float, day: str, machine: str = "huanghai", **more: float) -> CatchTest:
    return CatchTest(
        date=dt.date.fromisoformat(day), machine=machine, grams_per_rev_mm=grams, **more
    )


@pytest.fixture
def job(tmp_path) -> Path:
    """A job with a product that this machine has caught twice."""
    save_config(
        tmp_path / "mine.yaml",
        prills(
            caught(5.9, "2025-03-01"),
            caught(6.2, "2026-03-17"),
            caught(1.4, "2026-03-18", "spreader"),
        ),
        PRODUCT_KIND,
    )
    demo = load_config("demo", JOB_KIND).model
    save_config(
        tmp_path / "job.yaml", demo.model_copy(update={"product_file": "mine.yaml"}), JOB_KIND
    )
    return tmp_path / "job.yaml"


def test_the_newest_test_with_this_machine_counts(job):
    setup = load_setup("huanghai", str(job), TODAY)
    assert setup.machine.flow.grams_per_rev_mm == 6.2 and setup.crop.product_n_fraction == 0.46
    assert setup.crop.product == "Urea, prilled" and setup.rule.crop is setup.crop
    record = setup.machine.adopted[-1]
    assert (record.id, record.date) == ("flow.grams_per_rev_mm", "2026-03-17")
    assert str(job.parent / "mine.yaml") in setup.sha256
    assert load_setup("spreader", str(job), TODAY).machine.flow.grams_per_rev_mm == 1.4
    bench = load_setup("bench", str(job), TODAY)
    assert bench.machine == load_config("bench", MACHINE_KIND).model, (
        "never caught with it: its own file counts"
    )
    assert "no catch test with machine bench" in describe_product(bench.product, bench.machine)


def test_a_jobs_rate_follows_the_n_share(job):
    """The same nitrogen, in 46 instead of 45 %: eq 2 divides by the share."""
    with_it, without = (
        load_setup("huanghai", str(job), TODAY),
        load_setup("huanghai", "demo", TODAY),
    )
    assert with_it.rule.decide_rate(0.5).rate_kg_ha == pytest.approx(
        without.rule.decide_rate(0.5).rate_kg_ha * 0.45 / 0.46
    )


def test_files_of_before_read_equal():
    """A job that names no product: machine and crop are those of their files, the product in
    the crop included."""
    setup = load_setup("huanghai", "demo", TODAY)
    assert setup.product is None and setup.machine == load_config("huanghai", MACHINE_KIND).model
    assert (setup.crop.product, setup.crop.product_n_fraction) == ("urea", 0.45)


def test_what_a_test_tells_replaces_what_was_told():
    machine = load_config("huanghai", MACHINE_KIND).model
    machine = machine.model_copy(
        update={"flow": machine.flow._replace(gain_percent=4.0, zero_offset_g_rev=3.0)}
    )
    found = apply_product(machine, prills(caught(6.0, "2026-03-17", fill_falloff_percent=2.0))).flow
    assert (found.gain_percent, found.zero_offset_g_rev, found.fill_falloff_percent) == (
        0.0,
        0.0,
        2.0,
    )
    two = prills(caught(6.0, "2026-03-17"), caught(6.1, "2026-03-17"), caught(5.0, "2026-03-01"))
    assert two.find_newest_test("huanghai").grams_per_rev_mm == 6.1, (
        "of one day the one that stands last"
    )
    with pytest.raises(ValueError, match="catch test of 2026-03-17 with huanghai"):
        apply_product(machine, prills(caught(6.0, "2026-03-17", zero_offset_g_rev=90000.0)))


@pytest.mark.parametrize(
    "change",
    [
        {"n_fraction": 0.0},
        {"density_kg_l": 9.0},
        {"colour": "white"},
        {
            "catch_tests": [
                {
                    "date": "2026-03-18",
                    "machine": "m",
                    "grams_per_rev_mm": 5.0,
                    "low": 5.1,
                    "high": 5.2,
                }
            ]
        },
    ],
)
def test_what_is_not_allowed(change):
    with pytest.raises(ValidationError):
        Product.model_validate(
            load_config("urea_prilled", PRODUCT_KIND).model.model_dump() | change
        )


def test_check_tells_of_the_product(job, tmp_path):
    said = topdress("check", job, "bench")
    assert (
        said.exit_code == 0
        and "product urea_prilled: no catch test with machine bench" in said.output
    )
    save_config(
        job,
        load_config(str(job), JOB_KIND).model.model_copy(update={"product_file": "none.yaml"}),
        JOB_KIND,
    )
    said = topdress("check", job)
    assert said.exit_code != 0 and "none.yaml" in said.output
    with pytest.raises(ConfigError, match="name it in the job file"):
        from topdress.drivers.files.run_setup import load_by_kind

        load_by_kind([str(find_shipped_files("products")["can_27"])])


def test_a_catch_test_is_added_with_its_date(tmp_path):
    """A table of a machine that gives 6.1 g a turn and mm."""
    table = tmp_path / "catch.csv"
    rows = [(rpm, mm, 60.0, 6.1 * mm * rpm / 1000.0) for rpm in (20, 40, 60) for mm in (10, 25, 40)]
    table.write_text(
        "shaft_rpm,opening_mm,duration_s,mass_kg\n"
        + "".join(
            f"{a},{b},{c},{d * (1 + 0.001 * (-1) ** k)}\n" for k, (a, b, c, d) in enumerate(rows)
        )
    )
    out = tmp_path / "mine.yaml"
    said = topdress(
        "calibrate",
        "catch",
        table,
        "--product",
        "urea_prilled",
        "--date",
        "2026-03-18",
        "--out",
        out,
    )
    assert said.exit_code == 0, said.output
    test = load_config(str(out), PRODUCT_KIND).model.find_newest_test("huanghai")
    assert (
        test.grams_per_rev_mm == pytest.approx(6.1, rel=0.002)
        and test.date == TODAY
        and len(test.sha256) == 64
    )
    again = tmp_path / "again.yaml"
    said = topdress(
        "calibrate", "catch", table, "--product", out, "--date", "2026-03-19", "--out", again
    )
    assert said.exit_code == 0 and len(load_config(str(again), PRODUCT_KIND).model.catch_tests) == 2
    for more in (
        ["--out", str(out), "--product", str(out)],
        ["--out", str(tmp_path / "x.yaml"), "--date", "today"],
    ):
        assert topdress("calibrate", "catch", table, *more).exit_code != 0


@pytest.fixture
def desk(tmp_path):
    launcher = Launcher((), (), 1, 20.0, str(tmp_path / "logs" / "run.csv"), tmp_path / "trouble")
    (tmp_path / "products").mkdir()
    save_config(
        tmp_path / "products" / "mine.yaml", prills(caught(6.2, "2026-03-17")), PRODUCT_KIND
    )

    async def link(resumed=None):
        """A worker that starts with what was taken."""

    launcher.start_link = link
    return JobFiles(launcher, tmp_path)


async def test_another_product_in_the_cab_brings_its_flow(desk, tmp_path):
    """Before, it was a name only: 5.5 g a turn and mm stayed whatever was filled in."""
    facts = desk.find_facts()
    assert facts.setup.machine.flow.grams_per_rev_mm == 5.5 and not facts.product_file
    mine = next(one.value for one in facts.products if one.label == "mine")
    assert {one.label for one in facts.products} >= {"mine", "urea_prilled", "can_27"}
    desk.save_job_names(JobNames(product="mine", product_file=mine))
    await desk.restart_worker()
    facts = desk.find_facts()
    assert (facts.setup.machine.flow.grams_per_rev_mm, facts.setup.crop.product_n_fraction) == (
        6.2,
        0.46,
    )
    line = next(
        one for one in list_checks(None, 0.0, facts, "", None, METRIC) if one.label == "product"
    )
    assert line.level == OK and "6.20 g a turn and mm (catch test of 2026-03-17)" in line.text
    desk.save_job_names(
        JobNames(product="can_27", product_file=str(find_shipped_files("products")["can_27"]))
    )
    await desk.restart_worker()
    line = next(
        one
        for one in list_checks(None, 0.0, desk.find_facts(), "", None, METRIC)
        if one.label == "product"
    )
    assert line.level == LOOK and "no catch test with this machine" in line.text
    desk.save_job_names(JobNames(product="from a neighbour"))
    await desk.restart_worker()
    facts = desk.find_facts()
    assert (facts.names.product, facts.product_file) == ("from a neighbour", "")
    assert facts.setup.machine.flow.grams_per_rev_mm == 5.5
