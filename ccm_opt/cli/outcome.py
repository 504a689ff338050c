"""Exit codes: which error ends with which code, and what is printed about it.

====  =====================================================================
0     solved, or every check holds
1     a bug in ccm_opt, and its traceback is printed; or memory was used
      up, or stdout could not be written, and that is printed
2     bad input
3     no plan, or a plan that the verifier refuses; the reason is printed
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
"""Spaces that stay inside a line: before a unit, within a place or a row of numbers, after a sign of comparison."""
KEPT = "\u00a0"
"""Stands for such a space while lines are folded; no-break space."""
INDENT = "    "
"""In front of what continues a line."""


def folded(text: str, width: int) -> str:
    """Return a text whose lines fit a width where its words allow; every line by itself, its continuation indented.

    Args:
        text: perhaps of several lines.
        width: in characters.
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
"""Which exit code counts when several files end with different ones."""

Item = TypeVar("Item")


def run_all(items: Iterable[Item], run: Callable[[Item], int], name: Callable[[Item], str] = str) -> int:
    """Run every item and return the worst exit code; only Ctrl-C stops early.

    Args:
        items: for example files; they stand in front of the messages about them.
        run: of one item; returns its exit code.
        name: of an item.
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
    """Print an error for people, on stderr."""
    output().add_message("errors", message)
    _print_on_stderr("error:", "red", message)


def tell_reason(diagnosis: Diagnosis, *, last: bool = False) -> None:
    """Print why the item under way has no plan, on stderr: at once what is known, later what has been added.

    Args:
        diagnosis: as far as it is known.
        last: whether nothing will be added; only then advice is printed, which may not be the last word before.
    """
    shown = diagnosis if last else replace(diagnosis, advice=())
    item = output()
    told = item.told
    # A reason that another has taken the place of is among the others then, in one line.
    new = [line for line in str(shown).splitlines() if line.removeprefix("  also: ").split("; ")[0] not in told]
    if new and not told:
        _print_on_stderr("error:", "red", "\n".join((f"{item.item}: {new[0]}", *new[1:])))
    elif new:
        first = new[0] if new[0].startswith(" ") else f"  more exactly: {new[0]}"
        _print_on_stderr("", "red", "\n".join((first, *new[1:])))
    item.told = [*told, *(line.removeprefix("  also: ").split("; ")[0] for line in new)]
    item.note({"diagnosis": asdict(diagnosis), "errors": [f"{item.item}: {diagnosis}"]})


def warn(message: str) -> None:
    """Print one line that people should read, on stderr."""
    output().add_message("warnings", message)
    _print_on_stderr("warning:", "yellow", message)


def simulation_exit_code(name: str, verdict: SimulationVerdict) -> int:
    """Return the exit code of a simulated plan; when the arm does not follow it, the reason is printed on stderr."""
    if verdict.followed:
        return SOLVED
    advice = "".join(f"\n  try: {line}" for line in verdict.advice)
    warn(f"{name}: the simulated arm does not follow its plan ({verdict.outcome}): {verdict.reason}{advice}")
    return NOT_FOLLOWED


def print_result(show: Callable[[], object], code: int, data: Callable[[], Mapping[str, object]]) -> int:
    """Print a result on stdout, without giving up the work when nobody reads it.

    Args:
        show: prints it for people.
        code: exit code of the result.
        data: the same for programs; asked for where they are to read it.

    Returns:
        The code, also when the reader has gone; 1 when stdout cannot be written for another reason.
    """
    if output().as_json:
        output().note(data())
    if not output().tables:
        return code
    return _printed(show, code)


def print_document(document: Mapping[str, object]) -> None:
    """Print what programs are given, on stdout."""
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
    """Print on stderr, folded where it is a terminal's; nothing happens when nobody reads it."""
    try:
        console = Console(stderr=True, soft_wrap=True, highlight=False, emoji=False)
        text = f"{label} {message}" if label else message
        # What is no terminal gets whole lines, for other programs to read.
        text = folded(text, console.width) if console.is_terminal else text
        console.print(f"[{colour}]{label}[/{colour}]{escape(text[len(label) :])}")
    except (OSError, SystemExit):
        _silence(sys.stderr)


def _silence(stream: TextIO) -> None:
    """Send whatever is still printed nowhere: the interpreter flushes once more at its end."""
    with suppress(OSError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)


def _guarded(run: Callable[[Item], int], item: Item, name: str) -> int:
    """Run one item; whatever error it ends with becomes a message and an exit code."""
    try:
        return run(item)
    except (ProblemError, NativeLibraryError) as error:
        defects = [asdict(issue) for issue in error.issues] if isinstance(error, ProblemFileError) else []
        output().note({"status": "bad input"} | ({"defects": defects} if defects else {}))
        complain(str(error))
        return BAD_INPUT
    except NoPlanFound as error:
        output().note({"status": error.status})
        tell_reason(error.diagnosis, last=True)
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
    """Return what no stage has foreseen: memory is used up, or it is a bug, and its traceback is shown."""
    if is_out_of_memory(error):
        output().note({"status": "out of memory"})
        complain(f"{name}: out of memory; solving takes 0.6 to 1 GB of address space, and more for many links")
        return BUG
    if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
        # Whoever is the first to ask for a path gets this, be it only whether it is there.
        output().note({"status": "bad input"})
        complain(f"the path {error.filename} is too long for this system; choose a shorter one")
        return BAD_INPUT
    with suppress(OSError):  # the message below is worth trying even where stderr cannot be written
        traceback.print_exc()
    output().note({"status": "bug"})
    complain("this is a bug in ccm-opt; please report it with the lines above")
    return BUG
