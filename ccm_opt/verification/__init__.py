"""Independent continuous-time verification of a sampled joint trajectory; shares no code with the optimisers."""
