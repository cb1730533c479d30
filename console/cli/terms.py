"""How is a term of `--term` parsed, and how are terms explained in words?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from topdress.console.cli.plain_errors import CommandError
from topdress.drivers.plugins import find_effect

if TYPE_CHECKING:
    from collections.abc import Sequence

    from topdress.control.machine.terms import Term


def parse_terms(texts: Sequence[str]) -> list[Term]:
    """Returns terms of a simulated machine, each with an id of its own. Raises ValueError,
    CommandError, ConfigError."""
    from topdress.control.machine.terms import VARIABLES, parse_term

    found: list[Term] = []
    for text in texts:
        term = parse_term(text, _validate_term)
        for name in term.variable_names:
            if name not in VARIABLES:
                raise CommandError(
                    f"term {text!r}: variable {name}: the simulated machine has no such "
                    "column: allowed "
                    f"{', '.join(VARIABLES)}"
                )
        found.append(term.model_copy(update={"id": f"{term.id}.{len(found) + 1}"}))
    return found


def split_terms(effects: Sequence[str]) -> tuple[list[str], list[str]]:
    """Returns the effects of `--effect`: the plug-ins' effects as texts of terms, and the
    effects of the catalogue.
    Raises ValueError."""
    terms, own = list[str](), list[str]()
    for text in effects:
        name, _sign, size = text.strip().partition("=")
        plugin = find_effect(name)
        if plugin is None:
            own.append(text)
            continue
        try:
            terms.append(plugin.term.format(size=f"{float(size):g}"))
        except ValueError:
            raise CommandError(f"effect {text!r}: allowed is {name}=SIZE, a number") from None
    return terms, own


def _validate_term(data: dict[str, Any]) -> Term:
    from pydantic import ValidationError
    from topdress.control.machine.terms import Term
    from topdress.drivers.files.config import ConfigError
    from topdress.drivers.files.config_words import explain_errors

    try:
        return Term.model_validate(data)
    except ValidationError as error:
        raise ConfigError(explain_errors(error, Term, data, "--term", {})) from None


def describe_terms() -> list[str]:
    """Returns lines that explain a term, its targets, its functional forms and its variables."""
    from topdress.control.machine.term_form import FORMS
    from topdress.control.machine.terms import (
        TARGET_STAGES,
        TARGET_UNITS,
        TERM_EXAMPLE,
        TERM_GRAMMAR,
        VARIABLES,
    )

    return [
        "",
        "Beyond the catalogue: terms, in the machine file's list `terms` (docs/terms.md) or "
        "planted with --term.",
        f"    grammar: {TERM_GRAMMAR}",
        f"    example: {TERM_EXAMPLE}",
        "    acts on: "
        + ", ".join(
            f"{acts.value} ({TARGET_UNITS[acts]}, stage {stage})"
            for acts, stage in TARGET_STAGES.items()
        ),
        "    variables: "
        + ", ".join(f"{name} ({unit})" for name, unit in VARIABLES.items())
        + "; further columns of a log by name",
        *(
            f"    form {form}: {use.means}  ({', '.join(use.needs) or 'nodes, values'}"
            + (f"; may have {', '.join(use.may)})" if use.may else ")")
            for form, use in FORMS.items()
        ),
    ]
