"""Bodies moved by the robots' own limits, without SUMO: the same Euler steps, so that both engines agree."""
