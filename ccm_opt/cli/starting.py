"""The commands ``new`` and ``problems``, which write problem files to start from."""

import difflib
import re
import shlex
import tomllib
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

from rich.markup import escape

from ccm_opt.cli.compare.suites import shared_folder
from ccm_opt.cli.outcome import SOLVED, print_result, run_all
from ccm_opt.cli.tables import columned_table, report_console
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.reading import parse_problem

TEMPLATE = "template.toml"
"""File name of the commented planar problem that ``ccm-opt new`` writes, stored in the package ``io``."""
SPACE_TEMPLATE = "space_template.toml"
"""File name of the commented problem in space that ``ccm-opt new`` writes, stored in the package ``io``."""
SPACE_FOLDER = "space"
"""Name of the folder of example problems in space."""
_NAME = re.compile(r"\bNAME\b")


def write_new(file: Path, *, space: bool = False) -> int:
    """Write a commented example of a problem file, which can be solved, and return the exit code.

    Args:
        file: file to create; its name without ``.toml`` becomes the name of the problem.
        space: whether the arm moves in three dimensions.

    Returns:
        The exit code, see ``outcome``.
    """
    template = SPACE_TEMPLATE if space else TEMPLATE
    return run_all([file], lambda place: _write_new(place, template))


def _write_new(file: Path, template: str) -> int:
    place = file if file.suffix == ".toml" else file.with_name(f"{file.name}.toml")
    text = _NAME.sub(place.stem, (files("ccm_opt.io") / template).read_text(encoding="utf-8"))
    parse_problem(text, str(place))  # refuses names that cannot name a folder
    _write(place, text.encode())
    return print_result(
        lambda: report_console().print(
            escape(f"written to {place}; solve it with: ccm-opt solve {shlex.quote(str(place))}"), soft_wrap=True
        ),
        SOLVED,
        lambda: {"status": "written", "file": str(place)},
    )


def show_problems(names: Sequence[str], out: Path) -> int:
    """Print a list of the example problems of the package, or copy several of them, and return the exit code.

    Args:
        names: names of the problems to copy; if empty, all problems are listed.
        out: folder for the copies.

    Returns:
        The exit code, see ``outcome``.
    """
    known = listed_problems()
    if not names:
        return run_all(["problems"], lambda _: _list(known))
    taken: dict[Path, str] = {}
    return run_all(names, lambda name: _copy(name, known, out, taken))


def listed_problems() -> dict[str, Path]:
    """Return the files of the example problems of the package, by the names under which they are listed."""
    return {_listed_name(file): file for file in sorted(shared_folder().rglob("*.toml"), key=_listed_name)}


def _listed_name(file: Path) -> str:
    """Return the name under which an example problem is listed; problems in space have the prefix ``space/``."""
    return f"{SPACE_FOLDER}/{file.stem}" if file.parent.name == SPACE_FOLDER else file.stem


def _list(known: dict[str, Path]) -> int:
    # Only the TOML files are read: reading their drawings too would take longer than everything else.
    described = {
        name: str(tomllib.loads(file.read_text(encoding="utf-8"))["description"]) for name, file in known.items()
    }

    def show() -> None:
        table = columned_table("example problems of ccm-opt", ("name", "description"), unwrapped=1)
        table.columns[1].justify = "left"
        for name, description in described.items():
            table.add_row(name, escape(description))
        console = report_console()
        console.print(table)
        console.print("solve one: ccm-opt solve NAME; copy some: ccm-opt problems NAME…")

    return print_result(show, SOLVED, lambda: {"status": "listed", "problems": described})


def _copy(name: str, known: dict[str, Path], out: Path, taken: dict[Path, str]) -> int:
    """Copy one example problem with the drawing or meshes to which it refers, and return the exit code.

    Args:
        name: name of the problem.
        known: files of the example problems, by name.
        out: folder for the copies.
        taken: for each file copied so far, the name of its problem; receives the new copies.

    Raises:
        ProblemError: no problem has this name, or one of the files already exists.
    """
    if name not in known:
        close = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean '{close[0]}'?" if close else f"expected one of {', '.join(known)}"
        raise ProblemError(f"there is no problem '{name}'; {hint}")
    original = known[name]
    place = out / original.name
    copies = {place: original} | {out / beside: original.parent / beside for beside in _needed_files(original)}
    for copy in copies:
        if (first := taken.setdefault(copy, name)) != name:
            raise ProblemError(f"{copy} was just written for '{first}'; copy '{name}' with another --out")
        if copy.exists():
            raise ProblemError(f"{copy} exists and is not overwritten; choose another --out")
    for copy, source in copies.items():
        _write(copy, source.read_bytes())
    words = " and ".join(str(file) for file in copies)
    return print_result(
        lambda: report_console().print(f"written to {escape(words)}", soft_wrap=True),
        SOLVED,
        lambda: {"status": "copied", "file": str(place)},
    )


def _needed_files(file: Path) -> list[str]:
    """Return the relative paths of the drawing, meshes and scans to which a problem file refers, without duplicates."""
    workspace = tomllib.loads(file.read_text(encoding="utf-8")).get("workspace", {})
    named = [
        workspace.get("file"),
        *(entry.get("mesh") or entry.get("points") for entry in workspace.get("obstacles", [])),
    ]
    return list(dict.fromkeys(name for name in named if name is not None))


def _write(place: Path, content: bytes) -> None:
    """Write a new file, and create missing parent folders.

    Raises:
        ProblemError: the file already exists, or cannot be written.
    """
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        with place.open("xb") as file:
            file.write(content)
    except FileExistsError:
        raise ProblemError(f"{place} exists and is not overwritten; choose another name") from None
    except OSError as error:
        raise ProblemError(f"cannot write {place}: {error.strerror or error}") from error
