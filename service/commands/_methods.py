"""`luxmeter methods [NAME]`: the methods, or one method's settings, claims and transport."""

from __future__ import annotations

from typing import Annotated

import typer

from jobs.settings import dump, limits, schema
from renderers import Method, get_method, registered_methods
from renderers.scene.model import NEEDS
from service.describe import default_transport, method_document
from service.options import Json
from service.output import print_json, print_table


def methods(name: Annotated[str | None, typer.Argument(metavar="[NAME]")] = None, json: Json = False) -> None:
    """List the methods; with a NAME its settings, its transport, and how it meets what scenes need."""
    if name is None:
        found = list(registered_methods().values())
        if json:
            print_json([method_document(method) for method in found])
        else:
            print_table(("method", "", "transport", "source"), [(m.name, m.title, default_transport(m), m.source) for m in found])
        return
    method = get_method(name)
    if json:
        print_json(method_document(method))
    else:
        _show(method)


def _show(method: Method) -> None:
    print(f"{method.name}: {method.title}\n{method.source}\ntransport (default settings): {default_transport(method)}\n")
    defaults = dump(method.Settings())
    rows = []
    for key, field in schema(method)["properties"].items():
        unit = field.get("unit", "1")
        rows.append(
            (
                key,
                str(defaults[key]),
                limits(field),
                "" if unit == "1" else unit,
                field.get("description", ""),
                field.get("source", ""),
            )
        )
    print_table(("setting", "default", "range", "unit", "", "source"), rows)
    print()
    print_table(("need", "support", ""), [(n, method.claim(n).support, method.claim(n).how) for n in NEEDS])
