"""Where an arm in space ends: the NLP of a goal pose, its curve and its links tied together by the mapping."""
