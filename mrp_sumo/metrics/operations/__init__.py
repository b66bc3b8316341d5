"""The operations audit: could the work have happened as the logs say? Knows no state, dispatcher or planner."""
