"""Written plans that are corrupted in ways drawn at random, and whether ``ccm-opt check`` judges them right."""
