"""Tasks in processes that are forked from the worker's: all cores of a machine for one copy of the scene."""
