"""The user's constraints and costs as rows and terms of the goal-pose NLP: those that hold at the goal."""

from dataclasses import replace
from functools import lru_cache

import casadi as ca
import numpy as np

from ccm_opt.nlp.arm_pose.pose_program import PoseProgram
from ccm_opt.nlp.constraints import RowBlock
from ccm_opt.user_terms.compiled_terms import UserTerms
from ccm_opt.user_terms.functions import CompiledConstraint

GOAL = 1.0
"""Path parameter of the goal."""


@lru_cache(maxsize=4)  # the regions are drawn anew several times for one question; its solver is built once
def with_user_terms(program: PoseProgram, terms: UserTerms) -> PoseProgram:
    """The program with the user's hard constraints as rows, and soft ones and costs in its objective.

    Args:
        program: without them.
        terms: compiled for the same arm; those that do not cover the goal are left out.
    """
    rows = tuple(_rows_of(item, program.link_headings) for item in terms.hard_at_goal)
    parts = dict(program.parts)
    objective = program.objective
    for item in terms.all_costs:
        if bool(item.applies(np.array([GOAL]))[0]):
            value = item.function(program.link_headings, 0.0, GOAL)
            parts[f"user: {item.cost.name}"] = item.cost.weight * value
            objective += item.cost.weight * value
    return replace(program, rows=(*program.rows, *rows), parts=parts, objective=objective)


def _rows_of(item: CompiledConstraint, link_headings: ca.SX) -> RowBlock:
    """A hard constraint at the goal, one row an entry, in the user's unit."""
    name = item.constraint.name
    count = len(item.lower)
    names = (f"user: {name}",) if count == 1 else tuple(f"user: {name}, entry {k + 1}" for k in range(count))
    return RowBlock(names, item.function(link_headings, 0.0, GOAL), item.lower, item.upper)
