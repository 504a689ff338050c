"""Figure 3 of the paper: a hill climb that succeeds, and one that gets caught (section 3).

Left is the shared problem *open-space*: pure hill climbing (SCM-0) reaches the goal. Right is *local-maximum*: the
start bends to the left, the goal needs the other side. The climb brings the tip to within some centimetres of the goal;
then every move that would bring it nearer bends a joint beyond its limit or folds the arm into itself.

The paper is A. Hayashi, J. Park and B. J. Kuipers, *Toward Planning and Control of Highly Redundant Manipulators*
(1990). Run the script with a folder for the picture; the default is the current one::

    python examples/05_figure_3.py docs/images
"""

import sys
from pathlib import Path

import ccm_opt
from ccm_opt.planning.baseline.distance import TipPose
from ccm_opt.planning.baseline.hill_climb import SchemaStopped
from ccm_opt.planning.baseline.plans import Follower
from ccm_opt.planning.baseline.schemas import scm_0
from ccm_opt.viz.paper_figures import SchemaPanel, schemas_png

PROBLEMS = Path(__file__).parent.parent / "problems"


def climb(name: str) -> SchemaPanel:
    """SCM-0 alone on a shared problem."""
    problem = ccm_opt.load_problem(PROBLEMS / f"{name}.toml")
    follower, goal = Follower.from_problem(problem), problem.goal
    way, ending = [follower.start], "arrived"
    schema = scm_0(follower.world, follower.start, TipPose(goal.position, goal.heading))
    try:
        way.extend(step.configuration for step in schema)
    except SchemaStopped as stopped:
        ending = stopped.diagnosis.reason
    print(f"{name}: {len(way) - 1} moves; {ending}")
    title = f"SCM-0 on {name}: " + ("arrived" if ending == "arrived" else "caught")
    return SchemaPanel(title, tuple(way), goal)


def main() -> None:
    """Draw both climbs."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    picture = schemas_png([climb("open-space"), climb("local-maximum")], columns=2)
    (folder / "figure-3.png").write_bytes(picture)


if __name__ == "__main__":
    main()
