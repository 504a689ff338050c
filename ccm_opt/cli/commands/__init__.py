"""Every command and option of ``ccm-opt``: one function a command, which hands over to the module of its name.

Each returns its exit code, whose meaning is in ``outcome``; what happens on Ctrl-C is in ``cancelling``, and the
options that every command has are in ``command_group``. One file holds one family of commands.
"""

import sys
from typing import Annotated

import typer

from ccm_opt import __version__
from ccm_opt.cli.command_group import CommandGroup
from ccm_opt.cli.commands import beginning, examining, handing_on, judging, planning

app = typer.Typer(
    name="ccm-opt",
    cls=CommandGroup,
    help="Plan, time and verify motions of highly redundant manipulators.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def _show_version(wanted: bool) -> None:
    if wanted:
        sys.stdout.write(f"ccm-opt {__version__}\n")
        raise typer.Exit


@app.callback()
def _root(
    *,
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Plan, time and verify motions of highly redundant manipulators."""


# In this order they stand in the help.
for _family in (beginning, planning, judging, examining, handing_on):
    app.registered_commands.extend(_family.app.registered_commands)
