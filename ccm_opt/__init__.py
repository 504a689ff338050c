"""ccm_opt: certified, timed and simulated motions of highly redundant manipulators."""
__version__ = "0.1.0"
