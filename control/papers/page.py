"""Defines the content of a page of reproductions: sections with words, tables and pictures, and
claims next to the obtained results.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from typing import NamedTuple

TableCell = str | float | None


class Table(NamedTuple):
    """Holds a table. `decimals`: number of decimals of each column."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[TableCell, ...], ...]
    decimals: tuple[int, ...]


class Line(NamedTuple):
    """Holds a line of a picture. `kind`: published, ours or other; `joined`: whether points are
    joined by a line, otherwise shown as marks."""

    name: str
    kind: str
    x: Sequence[float]
    y: Sequence[float]
    joined: bool = False


class Picture(NamedTuple):
    """Holds a picture: its title, the labels of its axes, and its lines."""

    title: str
    x: str
    y: str
    lines: tuple[Line, ...]


class ResultOrigin(StrEnum):
    """Names the origin of an obtained number. A copied number has no result, because an input
    cannot confirm itself."""

    # The number follows from other printed numbers, by the paper's definition.
    RECOMPUTED = "recomputed"
    # Parameters were fitted to printed data and compared with the printed parameters.
    FITTED = "fitted"
    # The number comes from this program's models.
    SIMULATED = "simulated"
    # The number is an input, or is printed without data to calculate it.
    COPIED = "copied"


class Claim(NamedTuple):
    """Holds a claim of a paper.

    `where`: equation, table, figure or section; `says`: its content. `agrees`: None where nothing
    is compared. `within`: tolerance and its reason.
    """

    where: str
    says: str
    published: str
    obtained: str = ""
    how: ResultOrigin = ResultOrigin.COPIED
    agrees: bool | None = None
    remark: str = ""
    within: str = ""


class Section(NamedTuple):
    """Holds a section of a page."""

    title: str
    words: tuple[str, ...]
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()
    claims: tuple[Claim, ...] = ()


# The most frequent reason for a tolerance.
ROUNDING_TEXT = "half of the last digit printed"


def compare_numbers(
    where: str,
    says: str,
    published: float,
    obtained: float,
    within: float,
    form: str = "{:g}",
    *,
    how: ResultOrigin = ResultOrigin.RECOMPUTED,
    remark: str = "",
    why: str = ROUNDING_TEXT,
) -> Claim:
    """Compares two numbers, which agree if they differ by at most `within`, for the reason
    `why`. `form`: format of both, with the unit."""
    # The unit follows the number in the format, e.g. "{:.2f} m".
    unit = form.partition("}")[2].strip()
    return Claim(
        where,
        says,
        form.format(published),
        form.format(obtained),
        how,
        # The tolerance is widened by a share of 1e-9, so that rounding of floats decides nothing.
        abs(published - obtained) <= within * (1.0 + 1e-9),
        remark,
        f"{within:.3g}{' ' + unit if unit else ''}: {why}",
    )


def make_claim_table(name: str, claims: Sequence[Claim]) -> Table:
    """Returns every claim of a paper as a table.

    Raises ValueError for a copied number with a result, and for a verdict without a tolerance.
    """
    for claim in claims:
        # An input that agrees with itself would look like a confirmation.
        if (claim.how is ResultOrigin.COPIED) != (not claim.obtained):
            raise ValueError(
                f"{claim.where}, {claim.says}: obtained {claim.obtained!r} is {claim.how}"
            )
        # A verdict without a tolerance cannot be verified.
        if (claim.agrees is None) != (not claim.within):
            raise ValueError(
                f"{claim.where}, {claim.says}: agrees {claim.agrees}, within {claim.within!r}"
            )
    return Table(
        f"Everything that the {name} says",
        ("where", "what", "published", "obtained", "how", "agrees", "if within", "remark"),
        tuple(
            (
                c.where,
                c.says,
                c.published,
                c.obtained or None,
                c.how.value,
                _describe_verdict(c),
                c.within,
                c.remark,
            )
            for c in claims
        ),
        (0,) * 8,
    )


def _describe_verdict(claim: Claim) -> str:
    return "" if claim.agrees is None else "yes" if claim.agrees else "no"


def summarise_claims(papers: Sequence[Section]) -> Section:
    """Returns the number of claims of each kind, and the claims that do not agree."""
    counts: list[tuple[str | float, ...]] = []
    against: list[tuple[str, ...]] = []
    for paper in papers:
        counts.append(
            (
                paper.title,
                len(paper.claims),
                *(sum(c.how is how for c in paper.claims) for how in ResultOrigin),
                *(sum(c.agrees is verdict for c in paper.claims) for verdict in (True, False)),
            )
        )
        against += [
            (
                f"{paper.title.split(':')[0]}: {c.where}",
                c.says,
                c.published,
                c.obtained,
                c.within,
                c.remark,
            )
            for c in paper.claims
            # `is False` excludes claims that were not compared.
            if c.agrees is False
        ]
    rows, judged = (
        sum(len(paper.claims) for paper in papers),
        sum(int(row[-2]) + int(row[-1]) for row in counts),
    )
    return Section(
        "Summary",
        (
            f"{rows} equations, tables, figures and numeric claims of three papers. "
            f"{judged} can be held against "
            f"something; "
            f"{len(against)} of them do not come out, and are listed here with what was "
            "found. Every claim has its row in "
            "the chapter of its paper. A copied figure is an input or stands alone in the "
            "paper: nothing is said to be "
            "obtained for it.",
        ),
        (
            Table(
                "Claims by paper",
                ("paper", "claims", *(how.value for how in ResultOrigin), "agree", "do not"),
                tuple(counts),
                (0,) * (4 + len(ResultOrigin)),
            ),
            Table(
                "What does not come out",
                ("where", "what", "published", "obtained", "would agree within", "remark"),
                tuple(against),
                (0,) * 6,
            ),
        ),
    )
