"""The command ``size``: which arm a problem needs."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.markup import escape

from ccm_opt.cli.cancelling import last_steps_uninterrupted
from ccm_opt.cli.drawing import plan_pictures
from ccm_opt.cli.loading import NamedProblems, point_from
from ccm_opt.cli.outcome import print_result, run_all, simulation_exit_code
from ccm_opt.cli.solving import failures_recorded, write_unfinished
from ccm_opt.cli.stage_clock import stage_display
from ccm_opt.cli.tables import report_console, stage_line
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError, sentences
from ccm_opt.core.executors import DaskWorkers, Workers
from ccm_opt.core.length_words import file_length, words_in
from ccm_opt.core.length_words import place as at
from ccm_opt.diagnosis.sizes import SIZES
from ccm_opt.io.folder import SIZE_RECORD, check_target, write_folder
from ccm_opt.io.size_files import folder_of, front_files, size_files
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import ArmSize, SizeFront, SizeName

_SPOTS = 5
"""Default number of places along a line, and along each side of a rectangle."""

_LEAST_FIGURES, _MOST_FIGURES = 4, 9
"""Least and greatest number of significant digits of sizes, of which as many are shown as tell them apart."""


def size_problems(
    files: Sequence[Path],
    out: Path,
    changes: Sequence[str] = (),
    *,
    find: SizeName | None = None,
    line: tuple[str, str] | None = None,
    rectangle: tuple[str, str] | None = None,
    places: int | None = None,
    front: bool = False,
    time_limit: float | None = None,
    workers: int = 1,
    dask: str | None = None,
    pictures: bool = True,
) -> int:
    """Search for the arm that every problem file needs, write an output folder for each, and return the exit code.

    Args:
        files: problem files.
        out: parent folder of the output folders.
        changes: overrides of keys of the problem files, each ``key.path=value``.
        find: size to search for; None for the length.
        line: ends of a line of places for the base, each "x,y" or "x,y,z" in the file's unit.
        rectangle: opposite corners of a rectangle of places.
        places: number of places along the line, or along each side of the rectangle.
        front: whether to find the least length for several radii.
        time_limit: CPU time limit of one plan [s]; None for that of the problem.
        workers: number of processes on this machine.
        dask: address of a Dask scheduler; None for this machine.
        pictures: whether to make pictures, film and HTML report.

    Returns:
        The exit code of the worst outcome; after a failure the other files are still tried.
    """
    problems = NamedProblems(files, changes)
    crew: Workers | int = DaskWorkers(dask) if dask else workers

    def size_one(file: Path) -> int:
        _refuse_combinations(find, line, rectangle, places, front=front)
        problem = problems.read(file)
        spots = _spots(problem, line, rectangle, places or _SPOTS)
        options: dict[str, Any] = {"time_limit": time_limit, "workers": crew}
        return _size(problem, out, None if front else find or "length", spots, options, pictures=pictures)

    return run_all(files, size_one)


def _refuse_combinations(find: str | None, line: object, rectangle: object, places: int | None, *, front: bool) -> None:
    """Raise an error for options that have no effect together.

    Raises:
        ProblemError: there are such options.
    """
    if line and rectangle:
        raise ProblemError("--base-line and --base-rectangle: give one of them")
    if places is not None and not (line or rectangle):
        raise ProblemError("--places has no effect without --base-line or --base-rectangle")
    if front and (line or rectangle):
        raise ProblemError("--pareto is for one place of the base; leave out --base-line and --base-rectangle")
    if front and find not in {None, "length"}:
        raise ProblemError(f"--pareto finds the least length for several radii; leave out --find {find}")


def _spots(
    problem: Problem, line: tuple[str, str] | None, rectangle: tuple[str, str] | None, count: int
) -> FloatArray | None:
    """Return places of the base along a line or over a rectangle, shape (k, d) [m]; None for that of the problem.

    Raises:
        ProblemError: a place is invalid, or the corners are not those of a rectangle along the axes.
    """
    if line is None and rectangle is None:
        return None
    option, words = ("--base-line", line) if line is not None else ("--base-rectangle", rectangle)
    first, last = (point_from(problem, option, each) for each in words or ())
    parts = np.linspace(0.0, 1.0, count)
    if rectangle is None:
        return np.asarray(first + parts[:, None] * (last - first))
    sides = np.flatnonzero(first != last)
    if len(sides) != 2:
        raise ProblemError(
            f"{option}: the corners must differ in two coordinates, got {rectangle[0]} and {rectangle[1]}"
        )
    spots = np.tile(first, (count * count, 1))
    grid = np.stack(np.meshgrid(parts, parts), axis=-1).reshape(-1, 2)
    spots[:, sides] += grid * (last - first)[sides]
    return spots


def _size(
    problem: Problem,
    out: Path,
    find: SizeName | None,
    spots: FloatArray | None,
    options: Mapping[str, Any],
    *,
    pictures: bool,
) -> int:
    """Search for the arm that a problem needs, write its output folder, print the result, and return the exit code.

    Args:
        problem: the problem.
        out: parent folder of the output folders.
        find: size to search for; None for the least length for several radii.
        spots: places of the base, shape (k, d) [m]; None for that of the problem.
        options: time limit and workers.
        pictures: whether to make pictures, film and HTML report.
    """
    target = out / problem.name
    check_target(target)
    with stage_display(problem.name) as clock:
        clock.begin("loading")
        from ccm_opt.driver.sizing import size, size_front  # noqa: PLC0415 - loads casadi and toppra

        found: ArmSize | SizeFront
        with failures_recorded(problem, out, clock, pictures=False) as progress:
            if find is None:
                found = size_front(problem, progress=progress, **options)
            else:
                found = size(problem, find, places=spots, progress=progress, **options)
        clock.begin("writing")
        files = size_files(found) if isinstance(found, ArmSize) else front_files(found)
        best = found if isinstance(found, ArmSize) else found.sizes[found.best]
        assert best is not None  # noqa: S101 - at least one size has a plan
        try:
            drawn = _pictures(found, best) if pictures else {}
        except BaseException:
            write_unfinished(target, files)
            raise
        last_steps_uninterrupted()
        write_folder(target, {**files, **drawn})
        clock.finish()

    def show() -> None:
        console = report_console()
        with words_in(problem.length_unit):
            lines = [size_sentence(found, str(target))] if isinstance(found, ArmSize) else front_lines(found, target)
        for line in (f"{problem.name}: {lines[0]}", *lines[1:], stage_line(clock), f"written to {target}"):
            console.print(escape(line), soft_wrap=True)

    code = simulation_exit_code(problem.name, best.solution.simulation.verdict)
    return print_result(
        show, code, lambda: {"folder": str(target), "status": "solved", **json.loads(files[SIZE_RECORD])}
    )


def _pictures(found: ArmSize | SizeFront, best: ArmSize) -> Mapping[str, bytes]:
    pictures = dict(plan_pictures(best.solution))
    if isinstance(found, SizeFront):
        from ccm_opt.viz.size_picture import size_png  # noqa: PLC0415 - loads matplotlib

        pictures["size.png"] = size_png(found)
    return pictures


def size_sentence(found: ArmSize, folder: str) -> str:
    """Return what was found about the size of an arm: what is enough, and what is proved or not known of the next."""
    size = SIZES[found.find]
    figures = _figures(found)
    words = f"{found.enough.words(found.find, figures)} {size.enough} (plan in {folder})"
    if found.places > 1:
        words += f", with the base at {at(found.enough.base)}, the best of {found.places} places"
        left = found.places - 1 - found.places_proved
        others = [f"{found.places_proved} are proved not to be better by 2 %"] if found.places_proved else []
        others += [f"at {left} none better was found"] if left else []
        words += f" (of the others {', '.join(others)})"
    following, bound = found.following, found.bound
    if following is None:
        return f"{words}; nothing beyond was tried"
    name = following.words(found.find, figures)
    if following.outcome == "impossible":
        words += f"; {name} {size.beyond}: {following.reason} (proved)"
    else:
        why = sentences(following.reason)[0]
        words += f"; with {name} no plan was found within {following.limit:.3g} s of CPU time: {why}"
    if bound is not None and bound != following:
        words += f"; {bound.words(found.find, figures)} {size.beyond}: {bound.reason} (proved)"
    return words


def _figures(found: ArmSize) -> int:
    """Return the number of significant digits by which the sizes that are told differ."""
    told = [each for each in (found.enough, found.following, found.bound) if each is not None]
    values = {getattr(each, found.find) for each in told}
    enough = (
        k for k in range(_LEAST_FIGURES, _MOST_FIGURES) if len({t.words(found.find, k) for t in told}) == len(values)
    )
    return next(enough, _MOST_FIGURES)


def front_lines(found: SizeFront, folder: Path) -> list[str]:
    """Return a line for every radius: the length that is enough, and what is known of shorter arms."""
    lines: list[str] = []
    for number, (radius, size) in enumerate(zip(found.radii, found.sizes, strict=True), start=1):
        head = f"radius {file_length(radius)}: "
        if size is not None:
            lines.append(head + size_sentence(size, str(folder / folder_of(number))))
        else:
            bound = found.bounds[number - 1]
            proved = bound is not None and bound.reason == found.reasons[number - 1]
            lines.append(head + found.reasons[number - 1] + " (proved)" * proved)
    return lines
