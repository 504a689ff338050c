"""The order in which a motion visits goals in free order, in words and as a section of the HTML report."""

from collections.abc import Iterator

from ccm_opt.problem.poses import name_suffix
from ccm_opt.problem.solution import Solution, Tour
from ccm_opt.viz.document import Markup, element, table

_NO_EXCESS = 1e-4
"""Fraction of its duration up to which a tour counts as the shortest, as the integer program is solved to a
precision."""


def tour_sentences(tour: Tour) -> Iterator[str]:
    """Yield sentences about a tour: the order of its goals, and how its duration compares with that of other orders."""
    if tour.views:
        yield from _view_sentences(tour)
        return
    goals = len(tour.order) + len(tour.left_out)
    some = f"{len(tour.order)} of {goals} goals" if tour.left_out else f"{goals} goals"
    back = ", and back to the start" if tour.posed.planner.end == "start" else ""
    yield f"{some} in the order {', '.join(map(str, tour.order))} of the file{back}; checks number them as visited"
    bound = ", with the motions found no order is shorter" if tour.bound else ""
    if tour.excess > _NO_EXCESS:
        bound = f", with the motions found at most {100.0 * tour.excess:.2g} % longer than any order"
    as_given = f"with these motions in the given order {tour.as_given:.4g} s"
    yield f"{tour.duration:.4g} s of motion between goals{bound}; {as_given}"


def _view_sentences(tour: Tour) -> Iterator[str]:
    """Yield sentences about the views of a tour that has surfaces to see."""
    count = len(tour.views)
    some = f"{count} views see" if count > 1 else "1 view sees"
    least = f"at least {tour.fewest} of those sampled are needed"
    yield f"{some} enough; {least}{', so none fewer' if tour.fewest == count else ''}"
    if tour.unseen:
        yield f"not to be seen from any sampled view: {', '.join(tour.unseen)}"
    yield f"{tour.duration:.4g} s of motion between views"


def tour_section(solution: Solution) -> Markup | None:
    """Return the section of a report about the order of the goals and what it leaves out; None for a given order."""
    tour = solution.tour
    if tour is None:
        return None
    time = solution.trajectory.time
    samples = [*solution.trajectory.stops, len(time) - 1]
    goals = tour.posed.numbered_goals
    titles = [f"view {k}" if tour.views else f"goal {k}{name_suffix(goals[k - 1].goal)}" for k in tour.order]
    visits = [
        (str(visit), title, f"{time[sample]:.2f} s")
        for visit, (title, sample) in enumerate(zip(titles, samples, strict=False), start=1)
    ]
    missing = [element("li", f"{tour.goal_title(goal.goal)}: {goal.reason}") for goal in tour.left_out]
    left_out = (element("h3", "Goals left out"), element("ul", *missing)) if missing else ()
    sentences = (element("p", f"{sentence[0].upper()}{sentence[1:]}.") for sentence in tour_sentences(tour))
    return element(
        "section",
        element("h2", "Order of the goals"),
        *left_out,
        *sentences,
        table(("visit", "found" if tour.views else "in the file", "time"), visits, numbers=(0, 2)),
    )
