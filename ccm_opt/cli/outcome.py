"""Exit codes of commands, messages about errors, and output of results.

====  =====================================================================
0     solved, or every check holds
1     a bug in ccm_opt, with traceback; or memory was exhausted, or stdout
      could not be written, with a message
2     invalid input
3     no plan, or a plan that the verifier rejects; the reason is printed
4     a verified plan, written as usual, that the simulated arm did not
      follow: it reached a limit, collided, lost control, or could not be
      simulated; the reason is printed
5     a verified plan, written as usual, that leaves out goals in free
      order, which were not reached; each is named with the reason
130   cancelled by Ctrl-C, see ``cancelling``
====  =====================================================================

All of several files are tried; the exit code is that of the worst outcome, in the order 1, 130, 3, 2, 5, 4, 0.
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
from ccm_opt.problem.solution import SimulationVerdict, Tour

UNBROKEN = re.compile(
    r"(?<=\d) (?=(?:mm|m|s|kg|N|rad|times)\b|%)"
    r"|(?<=N) (?=m\b)"
    r"|(?<=\d,) (?=[-\d])"
    r"|(?<=[≤≥=]) (?=[-\d])"
)
"""Spaces at which lines are not wrapped: before a unit, within a position or row of numbers, after a comparison."""
KEPT = "\u00a0"
"""Placeholder, while text is wrapped, for spaces that must not be broken: a no-break space."""
INDENT = "    "
"""Indentation of continuation lines of wrapped text."""


def folded(text: str, width: int) -> str:
    """Return a text wrapped to a maximum width where possible, with continuation lines indented.

    Args:
        text: one or more lines, each wrapped separately.
        width: maximum width [characters].
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
IN_PART = 5
WORST_FIRST = (BUG, CANCELLED, NO_PLAN, BAD_INPUT, IN_PART, NOT_FOLLOWED, SOLVED)
"""Exit codes in order of precedence, for several files."""

Item = TypeVar("Item")


def run_all(items: Iterable[Item], run: Callable[[Item], int], name: Callable[[Item], str] = str) -> int:
    """Run a function on every item and return the worst exit code; only Ctrl-C ends the sequence early.

    Args:
        items: items to run, such as files; messages about an item begin with its name.
        run: function of one item that returns its exit code, or raises.
        name: function of one item that returns its name.
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
    """Print an error message on stderr, and add it to the JSON document of the command."""
    output().add_message("errors", message)
    _print_on_stderr("error:", "red", message)


def report_reason(diagnosis: Diagnosis, *, last: bool = False) -> None:
    """Print on stderr why no plan was found for the current item; repeated calls print only new lines.

    Args:
        diagnosis: reasons known so far.
        last: whether the diagnosis is final; only then is advice printed, which may change until then.
    """
    shown = diagnosis if last else replace(diagnosis, advice=())
    item = output()
    reported = item.reported
    # A reason printed earlier may have become a secondary one ("also: …"); it is not printed again.
    new = [line for line in str(shown).splitlines() if line.removeprefix("  also: ").split("; ")[0] not in reported]
    if new and not reported:
        _print_on_stderr("error:", "red", "\n".join((f"{item.item}: {new[0]}", *new[1:])))
    elif new:
        first = new[0] if new[0].startswith(" ") else f"  more precisely: {new[0]}"
        _print_on_stderr("", "red", "\n".join((first, *new[1:])))
    item.reported = [*reported, *(line.removeprefix("  also: ").split("; ")[0] for line in new)]
    item.note({"diagnosis": asdict(diagnosis), "errors": [f"{item.item}: {diagnosis}"]})


def warn(message: str) -> None:
    """Print a warning on stderr, and add it to the JSON document of the command."""
    output().add_message("warnings", message)
    _print_on_stderr("warning:", "yellow", message)


def simulation_exit_code(name: str, verdict: SimulationVerdict) -> int:
    """Return the exit code for the simulation of a plan; if the arm did not follow it, warn with the reason."""
    if not verdict.is_failure:
        if not verdict.followed:
            warn(f"{name}: the plan was not simulated: {verdict.reason}")
        return SOLVED
    advice = "".join(f"\n  try: {line}" for line in verdict.advice)
    warn(f"{name}: the simulated arm does not follow its plan ({verdict.outcome}): {verdict.reason}{advice}")
    return NOT_FOLLOWED


def tour_exit_code(name: str, tour: Tour | None) -> int:
    """Return the exit code for the goals that a plan visits; if it leaves some out, warn with the reasons."""
    if tour is None or not tour.left_out:
        return SOLVED
    count = len(tour.order) + len(tour.left_out)
    lines = "".join(f"\n  {tour.goal_title(goal.goal)}: {goal.reason}" for goal in tour.left_out)
    warn(f"{name}: {len(tour.left_out)} of {count} goals are left out:{lines}")
    return IN_PART


def print_result(show: Callable[[], object], code: int, data: Callable[[], Mapping[str, object]]) -> int:
    """Print a result on stdout, or add it to the JSON document, and return the exit code.

    Args:
        show: function that prints the result for people.
        code: exit code of the result.
        data: function that returns the result for the JSON document; called only if JSON is requested.

    Returns:
        ``code``, even if stdout is a closed pipe; 1 if writing to stdout fails for another reason.
    """
    if output().as_json:
        output().note(data())
    if not output().tables:
        return code
    return _printed(show, code)


def print_document(document: Mapping[str, object]) -> None:
    """Print the JSON document of a command on stdout."""
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
    """Print a labelled message on stderr, wrapped if stderr is a terminal; a closed stderr is ignored."""
    try:
        console = Console(stderr=True, soft_wrap=True, highlight=False, emoji=False)
        text = f"{label} {message}" if label else message
        # Other programs read whole lines, so only a terminal gets folded ones.
        text = folded(text, console.width) if console.is_terminal else text
        console.print(f"[{colour}]{label}[/{colour}]{escape(text[len(label) :])}")
    except (OSError, SystemExit):
        _silence(sys.stderr)


def _silence(stream: TextIO) -> None:
    """Redirect a broken stream to the null device, since Python flushes the stream again at shutdown."""
    with suppress(OSError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)


def _guarded(run: Callable[[Item], int], item: Item, name: str) -> int:
    """Return the exit code of a function run on one item; an error is printed as a message and gives an exit code."""
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
    """Report an unforeseen error (exhausted memory, a path that is too long, or a bug) and return the exit code."""
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
