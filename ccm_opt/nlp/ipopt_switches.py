"""IPOPT's switches that both of the curve's programs set; numbers come from their settings."""

from types import MappingProxyType
from typing import Any

IPOPT_SWITCHES: MappingProxyType[str, Any] = MappingProxyType(
    {
        "print_time": False,
        "error_on_fail": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.acceptable_iter": 0,
        "ipopt.mu_strategy": "adaptive",
        "ipopt.nlp_scaling_method": "none",
        # The matrices are small and well scaled by themselves: a fifth of the time goes, the iterates stay.
        "ipopt.fast_step_computation": "yes",
        "ipopt.min_refinement_steps": 0,
        "ipopt.mumps_permuting_scaling": 0,
        "ipopt.mumps_pivot_order": 0,
        "ipopt.mumps_scaling": 0,
    }
)
"""Silent, without an acceptable level of its own, and without scaling."""
