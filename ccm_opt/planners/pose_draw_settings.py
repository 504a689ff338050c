"""Settings of the random poses from which the goal-pose NLP is started besides the pose that the search arrived at."""

from dataclasses import dataclass


@dataclass(frozen=True)
class PoseDrawSettings:
    """How poses at the goal are drawn.

    Attributes:
        starts: random poses for each number of whole turns of the tip, from which the cheapest poses without walls are
            looked for (measured: in clutter 40 find what 100 find, 12 not always).
        start_cost: mean cost of these starts above the least, in units of the objective (taste).
        descents: steps of the descent to the cheapest pose without walls (measured: 20 converge).
        line: shares of a step of the descent that are tried at once (taste).
        longest_turn: largest turn of a link in one step [rad] (taste).
        whole_turns: whole turns of the tip to either side of its heading at the start that are looked at (taste).
        draws: poses drawn about each of the cheapest poses at once (measured: in clutter a tenth cross nothing).
        batches: how often they are drawn while none of them crosses nothing (taste).
        newton_steps: that bring a drawn pose onto the goal (measured: eight bring nine of ten there).
        spread: costs of the poses drawn reach from the least to this share of what they have to stay below (taste).
        near_enough: distance from the goal, in units of the arm's length, at which a drawn pose is a start (taste).
        kept_off: share of the radius that the axis of a start keeps from walls; the NLP brings the rest (taste).
        penalty: price of missing the goal in the descent, over the largest multiplier (as in any exact penalty).
        forgetting: share of that price that stays from step to step (taste).
        close_enough: a pose that costs no more than this share above what it would cost without walls is not improved
            upon (taste).
        unknown_cost: poses drawn cost less than this where no pose is known, in units of the objective (taste: more
            than having no room costs).
        drawn_solutions: drawn starts that are solved from, of different classes where there are (measured by
            ``tests.benchmarks.bench_goal_poses``).
        further_rounds: most further solutions for one pose, the regions drawn anew about it (measured: as before).
    """

    starts: int = 40
    start_cost: float = 3.0
    descents: int = 20
    line: tuple[float, ...] = (1.0, 0.5, 0.25, 0.1)
    longest_turn: float = 0.6
    whole_turns: int = 1
    draws: int = 200
    batches: int = 3
    newton_steps: int = 8
    spread: float = 1.5
    near_enough: float = 1e-4
    kept_off: float = 0.3
    penalty: float = 2.0
    forgetting: float = 0.7
    close_enough: float = 0.03
    unknown_cost: float = 20.0
    drawn_solutions: int = 2
    further_rounds: int = 3
