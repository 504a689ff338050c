"""The marks on the bar of a page's player: when the arm is at its goals."""

from ccm_opt.space.space_solution import AnySolution


def goal_times(solution: AnySolution) -> list[dict[str, object]]:
    """When the arm rests at a goal: those on the way, then the last."""
    time = solution.trajectory.time
    numbers = [*solution.trajectory.stops, len(time) - 1]
    single = len(numbers) == 1
    return [
        {"at": float(time[k]), "words": "goal" if single else str(n), "title": f"goal {n}, at {time[k]:.2f} s"}
        for n, k in enumerate(numbers, start=1)
    ]
