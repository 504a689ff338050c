"""``ccm-opt new`` and ``ccm-opt problems``: problem files to begin with."""

import re
import shlex
import tomllib
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

from rich.markup import escape

from ccm_opt.cli.outcome import SOLVED, print_result, run_all
from ccm_opt.cli.tables import columned_table, report_console
from ccm_opt.comparison.suites import shared_folder
from ccm_opt.errors import ProblemError
from ccm_opt.files.problem_file import parse_problem

TEMPLATE = "template.toml"
"""The commented problem that ``ccm-opt new`` writes, beside the reader of problem files."""
_NAME = re.compile(r"\bNAME\b")


def write_new(file: Path) -> int:
    """Write a commented problem that solves.

    Args:
        file: that is made; its name without ``.toml`` is the problem's.

    Returns:
        The exit code.
    """
    return run_all([file], _write_new)


def _write_new(file: Path) -> int:
    place = file if file.suffix == ".toml" else file.with_name(f"{file.name}.toml")
    text = _NAME.sub(place.stem, (files("ccm_opt.files.problem_file") / TEMPLATE).read_text(encoding="utf-8"))
    parse_problem(text, str(place))  # refuses names that cannot be a folder's
    _write(place, text)
    return print_result(
        lambda: report_console().print(
            escape(f"written to {place}; solve it with: ccm-opt solve {shlex.quote(str(place))}"), soft_wrap=True
        ),
        SOLVED,
        lambda: {"status": "written", "file": str(place)},
    )


def show_problems(names: Sequence[str], out: Path) -> int:
    """List the problems that come with the package, or copy some of them.

    Args:
        names: of those to copy; all are listed when there are none.
        out: folder for the copies.

    Returns:
        The exit code.
    """
    known = {file.stem: file for file in sorted(shared_folder().rglob("*.toml"), key=lambda file: file.stem)}
    if not names:
        return run_all(["problems"], lambda _: _list(known))
    return run_all(names, lambda name: _copy(name, known, out))


def _list(known: dict[str, Path]) -> int:
    # Of the files alone: reading their drawings as well would take longer than all the rest.
    described = {
        name: str(tomllib.loads(file.read_text(encoding="utf-8"))["description"]) for name, file in known.items()
    }

    def show() -> None:
        table = columned_table("problems that come with ccm-opt", ("name", "description"), unwrapped=1)
        table.columns[1].justify = "left"
        for name, description in described.items():
            table.add_row(name, escape(description))
        console = report_console()
        console.print(table)
        console.print("copy some with: ccm-opt problems NAME…")

    return print_result(show, SOLVED, lambda: {"status": "listed", "problems": described})


def _copy(name: str, known: dict[str, Path], out: Path) -> int:
    """Copy one problem, and the drawing that it may need.

    Raises:
        ProblemError: there is none of that name, or a file is in the place of one of the two.
    """
    if name not in known:
        raise ProblemError(f"there is no problem '{name}'; there are {', '.join(known)}")
    text = known[name].read_text(encoding="utf-8")
    place = out / f"{name}.toml"
    drawing = tomllib.loads(text).get("workspace", {}).get("file")
    copies = [place]
    if drawing is not None:
        copies.insert(0, out / drawing)
        _write(out / drawing, (known[name].parent / drawing).read_text(encoding="utf-8"))
    _write(place, text)
    words = " and ".join(str(file) for file in reversed(copies))
    return print_result(
        lambda: report_console().print(f"written to {escape(words)}", soft_wrap=True),
        SOLVED,
        lambda: {"status": "copied", "file": str(place)},
    )


def _write(place: Path, text: str) -> None:
    """Write a file that is not there yet.

    Raises:
        ProblemError: something is in its place, or nothing can be written there.
    """
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        with place.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise ProblemError(f"{place} is there already, and nothing of yours is replaced; choose another name") from None
    except OSError as error:
        raise ProblemError(f"cannot write {place}: {error.strerror or error}") from error
