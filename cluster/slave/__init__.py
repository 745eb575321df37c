"""A slave: a state machine that orders the jobs of its worker. It touches no socket and no clock."""
