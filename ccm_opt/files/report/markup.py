"""HTML that cannot be broken by names: text is escaped wherever it is not marked as markup already."""

from collections.abc import Iterable
from html import escape


class Markup(str):
    """Text that is HTML already; every other text is escaped when it is put into an element."""

    __slots__ = ()


Child = Markup | str | None
"""What an element may hold: markup, text, or nothing."""
_VOID = frozenset(("input", "br", "hr"))
"""Elements that hold nothing and have no end."""


def element(name: str, *children: Child, **attributes: str | float | bool | None) -> Markup:
    """An element of HTML.

    Args:
        name: of the element.
        children: what it holds; texts are escaped.
        attributes: by name; ``cls`` stands for ``class``, an underscore for a hyphen; None and False are left out.
    """
    named = {("class" if key == "cls" else key.replace("_", "-")): value for key, value in attributes.items()}
    written = "".join(
        _attribute(key, value) for key, value in named.items() if value is not None and value is not False
    )
    if name in _VOID:
        return Markup(f"<{name}{written}>")
    return Markup(f"<{name}{written}>{joined(children)}</{name}>")


def joined(children: Iterable[Child]) -> Markup:
    """Several things one after the other; texts are escaped."""
    return Markup("".join(child if isinstance(child, Markup) else escape(child) for child in children if child))


def table(
    heads: Iterable[Child], rows: Iterable[Iterable[Child]], *, cls: str = "", numbers: Iterable[int] = ()
) -> Markup:
    """A table that scrolls by itself where it is too wide for the page.

    Args:
        heads: of the columns; none for a table without heads.
        rows: of the table, cell by cell.
        cls: class of the table.
        numbers: columns that hold numbers, counted from 0.
    """
    right = frozenset(numbers)

    def cells(name: str, row: Iterable[Child]) -> Markup:
        return joined(element(name, cell, cls="n" if k in right else None) for k, cell in enumerate(row))

    heads = list(heads)
    head = element("thead", element("tr", cells("th", heads))) if heads else None
    body = element("tbody", *(element("tr", cells("td", row)) for row in rows))
    return element("div", element("table", head, body, cls=cls or None), cls="wide")


def _attribute(key: str, value: str | float | bool) -> str:
    return f" {key}" if value is True else f' {key}="{escape(str(value), quote=True)}"'
