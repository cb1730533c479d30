"""How does `topdress record` write passes as lines of a farm record, with kilograms and nitrogen by
product and field, and costs?
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from topdress.console.cli.inputs import LOG_KINDS, load_machine, refuse_other_kinds, require_suffix
from topdress.console.cli.outputs import (
    ForceOption,
    find_machine_file,
    list_log_files,
    make_marked_output,
    refuse_collisions,
)
from topdress.console.cli.plain_errors import CommandError
from topdress.console.cli.plain_output import AsJson, print_json

if TYPE_CHECKING:
    from topdress.control.machine.machine import Machine
    from topdress.drivers.files.exports.farm_record import FarmPass, FarmSum


def record_passes(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG...", help="Run logs, or logs of other programs.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FARM.csv",
            help="The farm record: a line for each log, added to "
            "those that are there. Without it: only the sums are printed.",
        ),
    ] = None,
    price: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PRODUCT=MONEY",
            help="Of a kilogram of a product "
            "(repeatable); MONEY alone: of every product. Without it: the "
            "job's price_per_kg.",
        ),
    ] = None,
    currency: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Of the money of --price; else as the job says, EUR."),
    ] = None,
    machine: Annotated[
        str | None, typer.Option(metavar="MACHINE", help="Of logs that name none.")
    ] = None,
    nitrogen: Annotated[
        float | None,
        typer.Option(
            metavar="SHARE", min=0.0, max=1.0, help="N in the product, of logs that name none."
        ),
    ] = None,
    as_json: AsJson = False,
    force: ForceOption = False,
) -> None:
    """Say what was spread on which field: kilograms, nitrogen, costs; and keep a line of it for
    the farm's books."""
    from topdress.drivers.files.exports.farm_record import sum_passes, write_farm_record
    from topdress.drivers.files.farm_lines import RECORD_BEGIN

    refuse_other_kinds(logs, LOG_KINDS)
    require_suffix("--out", out, ".csv")
    prices = _parse_prices(price or ())
    reads = [
        *(file for log in logs for file in list_log_files(log)),
        *([] if machine is None else [find_machine_file(machine)]),
    ]
    if out is not None:
        refuse_collisions(reads, [make_marked_output(out, RECORD_BEGIN)], force)
    loaded = load_machine(machine) if machine else None
    passes = [_make_pass(log, loaded, nitrogen, prices, currency) for log in logs]
    if prices and not any(_has_price(one, prices) for one in passes):
        raise CommandError(
            f"--price {', '.join(name for name in prices if name)}: no log spread that: allowed "
            f"{', '.join(sorted({one.product for one in passes}))}"
        )
    _print_sums(sum_passes(passes), as_json)
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        added, replaced = write_farm_record(passes, out)
        typer.echo(f"written      {out}: {added} added, {replaced} replaced", err=as_json)


def _parse_prices(texts: list[str] | tuple[()]) -> dict[str, float]:
    """Returns product -> price of a kilogram; the empty product stands for every product."""
    found = {}
    for text in texts:
        name, _, money = text.rpartition("=")
        try:
            value = float(money)
        except ValueError:
            value = -1.0
        if not 0.0 <= value < 1e6:
            raise CommandError(
                f"--price {text}: allowed PRODUCT=MONEY or MONEY, of a kilogram, 0 or more"
            )
        found[name.strip().casefold()] = value
    return found


def _has_price(one: FarmPass, prices: dict[str, float]) -> bool:
    """Returns whether a price was given for the product of a pass, or for every product."""
    return "" in prices or one.product.casefold() in prices


def _make_pass(
    log: Path,
    machine: Machine | None,
    nitrogen: float | None,
    prices: dict[str, float],
    currency: str | None,
) -> FarmPass:
    from topdress.console.reports.job_metadata import read_job_metadata
    from topdress.drivers.files.any_log import open_any_log
    from topdress.drivers.files.exports.as_applied import SpreadProduct, build_as_applied
    from topdress.drivers.files.exports.farm_record import FarmPass

    opened = open_any_log(log)
    about = read_job_metadata(opened)
    who = about.who
    given = None if nitrogen is None else SpreadProduct(who.product or "product", nitrogen)
    applied = build_as_applied(opened, machine, given)
    said = {
        "client": who.client,
        "farm": who.farm,
        "field": who.field,
        "crop": about.crop,
        "operator": who.operator,
        "product": who.product,
    }
    one = FarmPass(
        applied, said, about.simulated, log.name, about.price_per_kg, about.currency or "EUR"
    )
    if not _has_price(one, prices):
        return one
    return one._replace(
        price_per_kg=prices.get(one.product.casefold(), prices.get("")),
        currency=currency or one.currency,
    )


def _print_sums(found: list[FarmSum], as_json: bool) -> None:
    if as_json:
        print_json(found)
        return
    typer.echo(
        f"{'product':20} {'field':20} {'passes':>6} {'ha':>10} {'kg':>12} {'kg N':>10} "
        f"{'kg N/ha':>8} "
        f"{'cost':>12}"
    )
    for one in found:
        a_hectare = one.nitrogen_kg / one.hectares if one.hectares > 0.0 else 0.0
        cost = "" if one.cost is None else f"{one.cost:.2f} {one.currency}"
        typer.echo(
            f"{one.product[:20]:20} {(one.field or '-')[:20]:20} {one.passes:6d} "
            f"{one.hectares:10.4f} "
            f"{one.kilograms:12.2f} {one.nitrogen_kg:10.2f} {a_hectare:8.1f} {cost:>12}".rstrip()
        )
