"""The command ``tire-dynamics``: a module for each of its commands, and :mod:`main`, which finds them.

A command's module has ``add_arguments(parser)``, which declares its options, and ``run(options)``, which does what they
ask for, says on standard error what was made, and returns the exit status, 0 unless its docstring says otherwise.
"""
