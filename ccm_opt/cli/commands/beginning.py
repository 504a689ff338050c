"""Commands to begin with: a problem file of one's own, and those that come along."""

from pathlib import Path
from typing import Annotated

import typer

from ccm_opt.cli.command_group import command

app = typer.Typer()
"""The commands of this file."""


@command(app, "new", ("ccm-opt new mine", "ccm-opt new rigs/bulkhead.toml", "ccm-opt new --space duct"))
def new_command(
    file: Annotated[Path, typer.Argument(help="File to make.", metavar="FILE", show_default=False)],
    *,
    space: Annotated[bool, typer.Option("--space", help="Of an arm that leaves the plane.")] = False,
) -> int:
    """Write a commented problem file to begin with, which solves as it is."""
    from ccm_opt.cli.starting import write_new  # noqa: PLC0415 - loads numpy

    return write_new(file, space=space)


@command(app, "problems", ("ccm-opt problems", "ccm-opt problems swan-neck fork --out mine"))
def problems_command(
    names: Annotated[
        list[str] | None, typer.Argument(help="Problems to copy; all are listed without.", show_default=False)
    ] = None,
    *,
    out: Annotated[Path, typer.Option(help="Folder for the copies.")] = Path(),
) -> int:
    """List the problems that come with ccm-opt, or copy some of them."""
    from ccm_opt.cli.starting import show_problems  # noqa: PLC0415 - loads numpy

    return show_problems(names or (), out)
