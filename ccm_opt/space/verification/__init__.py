"""The independent verifier of motions in space: kinematics, distances and dynamics of its own."""

from ccm_opt.space.verification.space_verifier import verify_in_space

__all__ = ["verify_in_space"]
