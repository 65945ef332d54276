"""URScript: parsed by a grammar, compiled to steps of our own, and run a turn every period.

Nothing of a program ever becomes Python: it reaches its own variables and the functions that it is
given, and no more.
"""
