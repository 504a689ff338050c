"""Exit codes, and running one item of several so that every error ends as one of them."""

import traceback
from collections.abc import Callable, Iterable
from typing import TypeVar

from rich.console import Console
from rich.markup import escape

from ccm_opt.errors import NoPlanFound, ProblemError, VerificationError

SOLVED, BUG, BAD_INPUT, NO_PLAN, CANCELLED = 0, 1, 2, 3, 130

Item = TypeVar("Item")


def run_all(items: Iterable[Item], run: Callable[[Item], int]) -> int:
    """Run every item and return the worst exit code; only Ctrl-C stops early."""
    codes = []
    for item in items:
        codes.append(_guarded(run, item))
        if codes[-1] == CANCELLED:
            break
    return BUG if BUG in codes else max(codes, default=SOLVED)


def complain(message: str) -> None:
    """Print an error for people, on stderr."""
    Console(stderr=True, soft_wrap=True, highlight=False).print(f"[red]error:[/red] {escape(message)}")


def _guarded(run: Callable[[Item], int], item: Item) -> int:
    try:
        return run(item)
    except ProblemError as error:
        complain(str(error))
        return BAD_INPUT
    except (NoPlanFound, VerificationError) as error:
        complain(str(error))
        return NO_PLAN
    except KeyboardInterrupt:
        complain("cancelled")
        return CANCELLED
    except Exception:  # noqa: BLE001 - the other files are still tried; the traceback is shown
        traceback.print_exc()
        complain("this is a bug in ccm-opt; please report it with the lines above")
        return BUG
