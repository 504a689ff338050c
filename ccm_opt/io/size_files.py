"""Files of the search for the size of an arm: its record, the table of trials, and the plans."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from io import StringIO

from ccm_opt.core.files import strict_text
from ccm_opt.io.folder import SIZE_RECORD, solution_files
from ccm_opt.io.records import SCHEMA
from ccm_opt.problem.solution import ArmSize, SizeFront, SizeTrial


def size_files(found: ArmSize) -> dict[str, bytes]:
    """Return the files of an arm's size, except the pictures, as a mapping from file name to content.

    They are those of the plan, as ``solve`` would write them, with the record and the table of all trials.
    """
    record = {
        "schema": SCHEMA,
        "problem": found.solution.problem.name,
        "find": found.find,
        "places": found.places,
        "places_proved": found.places_proved,
        **_size_data(found),
        "trials": [asdict(each) for each in found.trials],
    }
    return {**solution_files(found.solution), **_tables(record, found.trials)}


def front_files(found: SizeFront) -> dict[str, bytes]:
    """Return the files of the least lengths for several radii, as a mapping from file name to content.

    The top level holds the plan of the radius nearest to the given one; the subfolder ``sizes`` holds every plan.
    """
    best = found.sizes[found.best]
    assert best is not None  # noqa: S101 - what it says
    files = solution_files(best.solution)
    rows: list[Mapping[str, object]] = []
    for number, size in enumerate(found.sizes, start=1):
        row: dict[str, object] = {"radius": found.radii[number - 1]}
        bound = found.bounds[number - 1]
        if size is None:
            row |= {"enough": None, "bound": bound and asdict(bound), "reason": found.reasons[number - 1]}
        else:
            row |= {"folder": folder_of(number), **_size_data(size)}
            files |= {f"{folder_of(number)}/{name}": text for name, text in solution_files(size.solution).items()}
        rows.append(row)
    trials = [asdict(each) for each in found.trials]
    record = {"schema": SCHEMA, "problem": found.problem.name, "find": "length", "radii": rows, "trials": trials}
    return {**files, **_tables(record, found.trials)}


def folder_of(number: int) -> str:
    """Return the subfolder of the plan for one of several radii, given its number from 1."""
    return f"sizes/{number}"


def _size_data(size: ArmSize) -> Mapping[str, object]:
    trials = {"enough": size.enough, "following": size.following, "bound": size.bound}
    return {name: trial and asdict(trial) for name, trial in trials.items()}


def _tables(record: Mapping[str, object], trials: Sequence[SizeTrial]) -> dict[str, bytes]:
    """Return the record, and a table of the trials with lengths in metres."""
    text = StringIO()
    table = csv.writer(text, lineterminator="\n")
    coordinates = [f"base_{axis}" for axis, _ in zip("xyz", trials[0].base, strict=False)]
    table.writerow(["length", "links", "radius", *coordinates, "outcome", "cpu", "limit", "reason"])
    for each in trials:
        row = [each.length, each.links, each.radius, *each.base, each.outcome, each.cpu, each.limit, each.reason]
        table.writerow(row)
    return {SIZE_RECORD: strict_text(record).encode(), "size.csv": text.getvalue().encode()}
