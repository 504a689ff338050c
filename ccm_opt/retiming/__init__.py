"""Retiming: the fastest motion along a joint path within velocity, acceleration and torque limits (TOPP-RA)."""

from ccm_opt.retiming.timing import retime

__all__ = ["retime"]
