"""Figure 5 of the paper: decomposition and schemas fold the arm past an obstacle (section 4.3).

The shared problem *fold-and-reach*: the straight arm must get behind a hanging wall. Panels as in the paper: (1) start
and goal; (2) change of type; (3) straight to the subgoal, half-way to the wall; (4) the tip segment traces the curve to
the goal while the base segment keeps the boundary on that curve with less and less length; (5) merge and climb; (6) all
of it. The paper is A. Hayashi, J. Park and B. J. Kuipers, *Toward Planning and Control of Highly Redundant
Manipulators* (1990)::

    python examples/07_figure_5.py docs/images
"""

import sys
from pathlib import Path

import ccm_opt
from ccm_opt.planning.baseline.distance import TipPose
from ccm_opt.planning.baseline.hill_climbing_planner import obstacle_ahead
from ccm_opt.planning.baseline.plans import Follower, fold_plan, subgoals
from ccm_opt.problem import TipGoal
from ccm_opt.viz.paper_figures import SchemaPanel, schemas_png

PROBLEMS = Path(__file__).parent.parent / "problems"


def main() -> None:
    """Run the fold plan and draw its stages."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    problem = ccm_opt.load_problem(PROBLEMS / "fold-and-reach.toml")
    follower, goal = Follower.from_problem(problem), TipPose(problem.goal.position, problem.goal.heading)
    subgoal = subgoals(follower.start.base, obstacle_ahead(problem, goal.position))[0]
    steps = list(fold_plan(follower.world, follower.start, subgoal, goal, sliding=True))
    names = dict.fromkeys(step.stage for step in steps)
    stages = {name: [step.configuration for step in steps if step.stage == name] for name in names}
    stages["6 all of it"] = [step.configuration for step in steps]
    hollow = TipGoal(subgoal.position, heading=subgoal.heading)
    panels = [
        SchemaPanel(f"({name[0]}){name[1:]}", tuple(way), problem.goal, problem.workspace, hollow)
        for name, way in stages.items()
    ]
    for name, way in stages.items():
        print(f"{name}: {len(way)} configurations, {len(way[-1].segments)} segment(s) at the end")
    (folder / "figure-5.png").write_bytes(schemas_png(panels, columns=2))


if __name__ == "__main__":
    main()
