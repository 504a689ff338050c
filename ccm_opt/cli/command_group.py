"""What all commands share: Ctrl-C while they load, the options that say how they print, examples in their help."""

import inspect
import logging
import sys
from collections.abc import Callable, Sequence
from functools import wraps
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from ccm_opt.cli.cancelling import report_cancelled
from ccm_opt.cli.loading import outside_files
from ccm_opt.cli.output import Output, printing


class CommandGroup(TyperGroup):
    """All commands; Ctrl-C while one of them loads its modules ends with exit code 130, where Typer's own is 1."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command that was asked for."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as interrupt:
            raise typer.Exit(report_cancelled()) from interrupt


_AS_JSON = Annotated[bool, typer.Option("--json", help="Print one JSON document in place of tables.")]
_QUIET = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors and warnings.")]
_VERBOSE = Annotated[bool, typer.Option("--verbose", "-v", help="Tell every stage, and every check.")]
_PRINTING = {"as_json": _AS_JSON, "quiet": _QUIET, "verbose": _VERBOSE}
"""Options of every command, which say how it prints."""
_ALLOW_OUTSIDE = Annotated[
    bool, typer.Option("--allow-outside", help="Read drawings that lie outside the folder of the problem file.")
]
"""Option of the commands that read problem files."""


def command(
    app: typer.Typer, name: str, examples: Sequence[str] = ()
) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Make a function a command, with the options that say how it prints.

    Args:
        app: receives the command.
        name: of the command.
        examples: lines as one would type them, shown below its help.

    Returns:
        A decorator for a function that returns the command's exit code.
    """

    def decorated(function: Callable[..., int]) -> Callable[..., int]:
        @wraps(function)
        def run(*, as_json: bool, quiet: bool, verbose: bool, allow_outside: bool = False, **options: Any) -> None:
            with printing(Output(name, as_json, quiet, verbose)) as out, outside_files(allowed=allow_outside):
                if verbose:
                    logging.basicConfig(level=logging.INFO, format="%(name)s: %(message)s")
                code = function(**options)
                if as_json:
                    _print_document(out, code)
            raise typer.Exit(code)

        own = list(inspect.signature(function, eval_str=True).parameters.values())
        reads_problems = any(each.name in {"changes", "item"} for each in own) or name == "compare"
        options_of_all = _PRINTING | ({"allow_outside": _ALLOW_OUTSIDE} if reads_problems else {})
        shared = [
            inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=kind)
            for key, kind in options_of_all.items()
        ]
        # Typer reads both to learn of the options.
        run.__signature__ = inspect.Signature([*own, *shared])  # type: ignore[attr-defined]
        run.__annotations__ = {each.name: each.annotation for each in [*own, *shared]}
        app.command(name, epilog=_epilog(examples))(run)
        return function

    return decorated


def _epilog(examples: Sequence[str]) -> str | None:
    """Examples as a block of lines of their own."""
    return "Examples:\n\n" + "\n\n".join(f"  {line}" for line in examples) if examples else None


def _print_document(out: Output, code: int) -> None:
    from ccm_opt.cli.outcome import print_document  # noqa: PLC0415 - loads what helps have no need of

    print_document(out.document(code))
    sys.stdout.flush()
