"""The master: a state machine that hands out work and puts the film together. It touches no socket and no clock."""
