"""Independent checks of a plan, continuous in time (``verifier``); shares no code with the planners."""
