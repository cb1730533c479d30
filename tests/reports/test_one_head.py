"""One head for all pages of reports: nothing is fetched or run, whoever wrote the words in them."""
from __future__ import annotations

from pathlib import Path

import console
from console.reports import html
from console.reports.fleet_page import fleet_page
from console.reports.paper_page import paper_page
from control.diagnosis.season.courses import Fit

SOURCES = sorted(Path(console.__file__).parent.rglob("*.py"))


def test_every_page_may_fetch_nothing() -> None:
    for text in (html.page("<script>", "p {}", "<p>said</p>"), paper_page([], "topdress"),
                 fleet_page([], Fit(), low=[], units={}, broken=(), price=None, currency="CNY", software="topdress")):
        head = text.partition("</head>")[0].lower()
        assert "default-src 'none'" in head and head.index("content-security-policy") < head.index("<title>")
        assert "<script>" not in text


def test_no_report_has_a_head_of_its_own() -> None:
    heads = [path.name for path in SOURCES if "<!doctype" in path.read_text(encoding="utf-8").lower()]
    assert heads == ["html.py"]


def test_pictures_that_stand_in_a_page_are_shown() -> None:
    """The scale of colours beside a map is a picture in the page itself."""
    policy = html.page("", "", "").partition("Content-Security-Policy")[2].partition(">")[0]
    assert "img-src data:" in policy and "http" not in policy and "*" not in policy
