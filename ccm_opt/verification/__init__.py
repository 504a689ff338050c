"""Independent checks of plans at all times, not only at samples; shares no code with the planners."""
