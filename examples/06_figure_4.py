"""Figure 4 of the paper: the climb of Figure 3, right, with a good segment type first (section 3.2).

SCM-1 selects the type and the base rotation from base and goal pose alone, SCM-2 moves there by interpolation, and
SCM-0 then climbs to the goal without getting caught. The paper is A. Hayashi, J. Park and B. J. Kuipers, *Toward
Planning and Control of Highly Redundant Manipulators* (1990)::

    python examples/06_figure_4.py docs/images
"""

import sys
from pathlib import Path

import ccm_opt
from ccm_opt.planning.baseline.distance import TipPose
from ccm_opt.planning.baseline.hill_climb import run
from ccm_opt.planning.baseline.plans import Follower
from ccm_opt.planning.baseline.schemas import scm_0, scm_1, scm_2
from ccm_opt.viz.paper_figures import SchemaPanel, schemas_png

PROBLEMS = Path(__file__).parent.parent / "problems"


def main() -> None:
    """Draw the interpolation to the selected type, then the climb."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    problem = ccm_opt.load_problem(PROBLEMS / "local-maximum.toml")
    follower, goal = Follower.from_problem(problem), TipPose(problem.goal.position, problem.goal.heading)
    selection = scm_1(follower.world, follower.start, goal)
    moved, here = run(scm_2(follower.world, follower.start, selection.configuration(follower.start.base)))
    climbed, _ = run(scm_0(follower.world, here, goal))
    print(f"SCM-1 selects {selection.kind}; SCM-2 takes {len(moved)} steps, SCM-0 {len(climbed)} moves")
    first = SchemaPanel(
        f"SCM-1 selects {selection.kind}; SCM-2",
        (follower.start, *(step.configuration for step in moved)),
        problem.goal,
    )
    second = SchemaPanel("SCM-0: arrived", (here, *(step.configuration for step in climbed)), problem.goal)
    (folder / "figure-4.png").write_bytes(schemas_png([first, second], columns=2))


if __name__ == "__main__":
    main()
