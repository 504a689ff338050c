"""The application ``ccm-opt``, how commands register with it, and the options that several of them have."""

import inspect
import logging
import os
import sys
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from ccm_opt import __version__
from ccm_opt.cli.cancelling import report_cancelled
from ccm_opt.cli.output import FigureKind, Output, printing


class CommandGroup(TyperGroup):
    """Group of all commands; Ctrl-C during the import of a command gives exit code 130 instead of Typer's 1."""

    def invoke(self, ctx: Any) -> Any:
        """Run the requested command and return its result."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as interrupt:
            raise typer.Exit(report_cancelled()) from interrupt


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
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Plan, time and verify motions of highly redundant manipulators."""


_AS_JSON = Annotated[bool, typer.Option("--json", help="Print one JSON document instead of tables.")]
_QUIET = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors and warnings only.")]
_VERBOSE = Annotated[bool, typer.Option("--verbose", "-v", help="Print every stage and every check.")]
_PRINTING = {"as_json": _AS_JSON, "quiet": _QUIET, "verbose": _VERBOSE}
"""Options that control output, common to all commands."""
_ALLOW_OUTSIDE = Annotated[
    bool, typer.Option("--allow-outside", help="Read drawings and meshes from outside the problem file's folder.")
]
"""Option of all commands that read problem files."""


def command(name: str, examples: Sequence[str] = ()) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Return a decorator that registers a function as a command, with the options that control output.

    Args:
        name: name of the command.
        examples: example command lines, shown below the help text.

    Returns:
        A decorator for functions that return the exit code of the command.
    """

    def decorated(function: Callable[..., int]) -> Callable[..., int]:
        @wraps(function)
        def run(*, as_json: bool, quiet: bool, verbose: bool, allow_outside: bool = False, **options: Any) -> None:
            with printing(Output(name, as_json, quiet, verbose, allow_outside)) as out:
                if verbose:
                    logging.basicConfig(level=logging.INFO, format="%(name)s: %(message)s")
                code = function(**options)
                if as_json:
                    from ccm_opt.cli.outcome import print_document  # noqa: PLC0415 - loads what helps have no need of

                    print_document(out.document(code))
            raise typer.Exit(code)

        parameters = list(inspect.signature(function, eval_str=True).parameters.values())
        reads_problems = any(each.name in {"changes", "item"} for each in parameters) or name == "compare"
        options_of_all = _PRINTING | ({"allow_outside": _ALLOW_OUTSIDE} if reads_problems else {})
        shared = [
            inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=kind)
            for key, kind in options_of_all.items()
        ]
        # Typer reads the options from both.
        run.__signature__ = inspect.Signature([*parameters, *shared])  # type: ignore[attr-defined]
        run.__annotations__ = {each.name: each.annotation for each in [*parameters, *shared]}
        epilog = "Examples:\n\n" + "\n\n".join(f"  {line}" for line in examples) if examples else None
        app.command(name, epilog=epilog)(run)
        return function

    return decorated


def listed_or_given(places: list[Path] | None) -> list[Path] | None:
    """Return file paths after replacing names listed by ``ccm-opt problems`` by the files of these problems.

    A path that exists is kept, and so is an unknown name. The result is None for None.
    """
    if places is None or all(place.suffix or os.path.exists(place) or str(place) == "-" for place in places):  # noqa: PTH110 - see below
        return places
    from ccm_opt.cli.starting import listed_problems  # noqa: PLC0415 - loads numpy

    known = listed_problems()
    # Path.exists raises an error if a name is too long.
    return [place if os.path.exists(place) else known.get(place.as_posix(), place) for place in places]  # noqa: PTH110


ProblemFiles = Annotated[
    list[Path],
    typer.Argument(
        help="Problem files, or names that `ccm-opt problems` lists; - for standard input.",
        metavar="FILE…",
        show_default=False,
        callback=listed_or_given,
    ),
]
FigureFormatOption = Annotated[FigureKind, typer.Option(help="Format of the pictures.")]
Constraints = Annotated[
    list[str] | None, typer.Option(help="User-defined constraint, as module:function or file.py:function. Repeatable.")
]
Costs = Annotated[
    list[str] | None, typer.Option(help="User-defined cost, as module:function or file.py:function. Repeatable.")
]
Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Override a key of the problem files, as in arm.radius=0.02. Repeatable."
    ),
]
Folders = Annotated[list[Path], typer.Argument(help="Output folders of solve.", metavar="FOLDER…", show_default=False)]
Workers = Annotated[int, typer.Option(min=1, help="Number of worker processes on this machine.")]
DaskAddress = Annotated[str | None, typer.Option(help="Address of a Dask scheduler, to run on its cluster instead.")]
