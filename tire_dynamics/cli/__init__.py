"""The command ``tire-dynamics``: a module for each of its commands, and :mod:`main`, which finds them."""
