"""What the compiled modules use of Cython, for where it is not installed: decorators that decorate nothing, no types.

A module of the compiled core is Python that Cython can compile. It begins with ::

    try:
        import cython
    except ImportError:
        from . import cython_stand_in as cython

and runs interpreted where no compiled file lies beside it. Annotations are never evaluated, so that only what is called
or subscripted needs a name here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

__all__ = [
    *("annotation_typing", "bint", "boundscheck", "cast", "ccall", "cclass", "cdivision", "cfunc", "compiled", "const"),
    *("declare", "double", "exceptval", "final", "gil", "initializedcheck", "inline", "int", "locals", "longlong"),
    *("nogil", "Py_ssize_t", "returns", "size_t", "uchar", "uint", "ulonglong", "void", "wraparound"),
]

Decorated = TypeVar("Decorated")

compiled = False


class _Type:
    """A C type: anything may be made of it, ``double[::1]``, ``const[double]``, and nothing comes of it."""

    def __getitem__(self, _: object) -> _Type:
        return self


class _NoGil:
    """Both ``@cython.nogil`` and ``with cython.nogil:``; ``cython.gil`` likewise."""

    def __call__(self, function: Decorated) -> Decorated:
        return function

    def __enter__(self) -> None:
        pass

    def __exit__(self, *_: object) -> None:
        pass


def _as_it_is(thing: Decorated) -> Decorated:
    return thing


def _with_arguments(*_: object, **__: object) -> Callable[[Decorated], Decorated]:
    return _as_it_is


def declare(type: object = None, value: Any = None, **_: object) -> Any:
    """The value of a declared variable."""
    return value


def cast(type: object, value: Any, **_: object) -> Any:
    """The value, whatever it is to be."""
    return value


Py_ssize_t = bint = const = double = int = longlong = size_t = uchar = uint = ulonglong = void = _Type()
gil = nogil = _NoGil()
ccall = cclass = cfunc = final = inline = _as_it_is
annotation_typing = boundscheck = cdivision = exceptval = initializedcheck = _with_arguments
locals = returns = wraparound = _with_arguments
