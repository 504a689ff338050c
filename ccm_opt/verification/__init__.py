"""Independent checks of a plan, continuous in time; shares no code with the planners."""

from ccm_opt.verification.verifier import verify

__all__ = ["verify"]
