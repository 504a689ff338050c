"""Exit codes, and the messages on errors.

====  =====================================================================
0     solved, or every check holds
1     a bug in ccm_opt, and its traceback is printed; or memory was used
      up, or stdout could not be written, and that is printed
2     bad input
3     no plan, or a plan that the verifier rejects; the reason is printed
4     a verified plan, written like every other, that the simulated arm did
      not follow: it met a limit, touched something, went out of control, or
      could not be simulated; the reason is printed
130   cancelled by Ctrl-C, see ``cancelling``
====  =====================================================================

Of several files all are tried; the exit code is that of the worst outcome: 1, then 130, 3, 2, 4 and 0.
"""

import errno
import os
import re
import sys
import textwrap
import traceback
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, replace
from typing import TextIO, TypeVar

from rich.console import Console
from rich.markup import escape

from ccm_opt.cli.cancelling import CANCELLED, cancelled_meanwhile, interrupt_met, interrupt_unmet, interrupts_as_usual
from ccm_opt.cli.output import output
from ccm_opt.cli.surroundings import is_out_of_memory
from ccm_opt.core.errors import (
    Diagnosis,
    NativeLibraryError,
    NoPlanFound,
    ProblemError,
    ProblemFileError,
    VerificationError,
)
from ccm_opt.core.files import strict_text
from ccm_opt.problem.solution import SimulationVerdict

UNBROKEN = re.compile(
    r"(?<=\d) (?=(?:mm|m|s|kg|N|rad|times)\b|%)"
    r"|(?<=N) (?=m\b)"
    r"|(?<=\d,) (?=[-\d])"
    r"|(?<=[≤≥=]) (?=[-\d])"
)
"""Spaces at which lines are not broken: before a unit, within a position or a row of numbers, after a comparison."""
KEPT = "\u00a0"
"""Placeholder for such a space while lines are folded: a no-break space."""
INDENT = "    "
"""Indent of continuation lines."""


def folded(text: str, width: int) -> str:
    """Return a text wrapped to a width where possible, line by line, with indented continuation lines.

    Args:
        text: one or more lines.
        width: width in characters.
    """
    lines = []
    for line in text.splitlines():
        indent = line[: len(line) - len(line.lstrip())]
        lines += textwrap.wrap(
            UNBROKEN.sub(KEPT, line.strip()),
            max(width, 1),
            initial_indent=indent,
            subsequent_indent=indent + INDENT,
            break_long_words=False,
            break_on_hyphens=False,
        ) or [""]
    return "\n".join(lines).replace(KEPT, " ")


SOLVED = 0
BUG = 1
BAD_INPUT = 2
NO_PLAN = 3
NOT_FOLLOWED = 4
WORST_FIRST = (BUG, CANCELLED, NO_PLAN, BAD_INPUT, NOT_FOLLOWED, SOLVED)
"""Order in which exit codes of several files take precedence."""

Item = TypeVar("Item")


def run_all(items: Iterable[Item], run: Callable[[Item], int], name: Callable[[Item], str] = str) -> int:
    """Run every item and return the worst exit code; only Ctrl-C ends the sequence early.

    Args:
        items: items to run, such as files; messages about an item begin with its name.
        run: runs one item; returns its exit code.
        name: returns the name of an item.
    """
    codes: list[int] = []
    for item in items:
        if codes and cancelled_meanwhile():
            complain("cancelled")
            codes.append(CANCELLED)
        if CANCELLED in codes:
            break
        output().begin(name(item))
        with interrupts_as_usual():
            codes.append(_guarded(run, item, name(item)))
        output().note({"exit_code": codes[-1]})
    return min(codes, key=WORST_FIRST.index, default=SOLVED)


def complain(message: str) -> None:
    """Print an error message on stderr."""
    output().add_message("errors", message)
    _print_on_stderr("error:", "red", message)


def report_reason(diagnosis: Diagnosis, *, last: bool = False) -> None:
    """Print on stderr why the current item has no plan; repeated calls print only new lines.

    Args:
        diagnosis: diagnosis as far as it is known.
        last: whether the diagnosis is final; advice is only printed then, since advice may change until then.
    """
    shown = diagnosis if last else replace(diagnosis, advice=())
    item = output()
    told = item.told
    # A reason printed earlier may have become a secondary one ("also: …"); it is not printed again.
    new = [line for line in str(shown).splitlines() if line.removeprefix("  also: ").split("; ")[0] not in told]
    if new and not told:
        _print_on_stderr("error:", "red", "\n".join((f"{item.item}: {new[0]}", *new[1:])))
    elif new:
        first = new[0] if new[0].startswith(" ") else f"  more precisely: {new[0]}"
        _print_on_stderr("", "red", "\n".join((first, *new[1:])))
    item.told = [*told, *(line.removeprefix("  also: ").split("; ")[0] for line in new)]
    item.note({"diagnosis": asdict(diagnosis), "errors": [f"{item.item}: {diagnosis}"]})


def warn(message: str) -> None:
    """Print a warning on stderr."""
    output().add_message("warnings", message)
    _print_on_stderr("warning:", "yellow", message)


def simulation_exit_code(name: str, verdict: SimulationVerdict) -> int:
    """Return the exit code of a simulated plan; if the arm does not follow it, print why on stderr."""
    if verdict.followed:
        return SOLVED
    advice = "".join(f"\n  try: {line}" for line in verdict.advice)
    warn(f"{name}: the simulated arm does not follow its plan ({verdict.outcome}): {verdict.reason}{advice}")
    return NOT_FOLLOWED


def print_result(show: Callable[[], object], code: int, data: Callable[[], Mapping[str, object]]) -> int:
    """Print a result on stdout; a closed pipe does not count as a failure.

    Args:
        show: prints the result for people.
        code: exit code of the result.
        data: returns the result for the JSON document; called only if JSON is requested.

    Returns:
        The given code, even if the pipe is closed; 1 if writing to stdout fails for another reason.
    """
    if output().as_json:
        output().note(data())
    if not output().tables:
        return code
    return _printed(show, code)


def print_document(document: Mapping[str, object]) -> None:
    """Print the JSON document on stdout."""
    _printed(lambda: sys.stdout.write(strict_text(document)), SOLVED)


def _printed(show: Callable[[], object], code: int) -> int:
    try:
        show()
        sys.stdout.flush()
    except (BrokenPipeError, SystemExit):  # Rich exits when a pipe breaks
        _silence(sys.stdout)
    except OSError as error:
        _silence(sys.stdout)
        complain(f"the result cannot be printed: {error}")
        return BUG
    return code


def _print_on_stderr(label: str, colour: str, message: str) -> None:
    """Print text on stderr, wrapped if stderr is a terminal; do nothing if stderr is closed."""
    try:
        console = Console(stderr=True, soft_wrap=True, highlight=False, emoji=False)
        text = f"{label} {message}" if label else message
        # Other programs read whole lines, so only a terminal gets folded ones.
        text = folded(text, console.width) if console.is_terminal else text
        console.print(f"[{colour}]{label}[/{colour}]{escape(text[len(label) :])}")
    except (OSError, SystemExit):
        _silence(sys.stderr)


def _silence(stream: TextIO) -> None:
    """Redirect a broken stream to the null device, since the interpreter flushes the stream again at shutdown."""
    with suppress(OSError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)


def _guarded(run: Callable[[Item], int], item: Item, name: str) -> int:
    """Run one item; convert any error to a message and an exit code."""
    try:
        return run(item)
    except (ProblemError, NativeLibraryError) as error:
        defects = [asdict(issue) for issue in error.issues] if isinstance(error, ProblemFileError) else []
        output().note({"status": "bad input"} | ({"defects": defects} if defects else {}))
        complain(str(error))
        return BAD_INPUT
    except NoPlanFound as error:
        output().note({"status": error.status})
        report_reason(error.diagnosis, last=True)
        return NO_PLAN
    except VerificationError as error:
        output().note({"status": "refused"})
        complain(f"{name}: {error}")
        return NO_PLAN
    except KeyboardInterrupt:
        return _cancelled()
    except Exception as error:  # noqa: BLE001 - the other files are still tried
        return _cancelled() if interrupt_unmet() else _broken_off(error, name)


def _cancelled() -> int:
    interrupt_met()
    output().note({"status": "cancelled"})
    complain("cancelled")
    return CANCELLED


def _broken_off(error: Exception, name: str) -> int:
    """Report an unforeseen error, lack of memory or a bug with its traceback, and return the exit code."""
    if is_out_of_memory(error):
        output().note({"status": "out of memory"})
        complain(f"{name}: out of memory; solving takes 0.6 to 1 GB of address space, and more for many links")
        return BUG
    if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
        # Raised by the first access to the path, even by a test whether it exists.
        output().note({"status": "bad input"})
        complain(f"the path {error.filename} is too long for this system; choose a shorter one")
        return BAD_INPUT
    with suppress(OSError):  # the message below is worth trying even where stderr cannot be written
        traceback.print_exc()
    output().note({"status": "bug"})
    complain("this is a bug in ccm-opt; please report it with the lines above")
    return BUG
