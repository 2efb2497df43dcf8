# cython: language_level=3

from .motion cimport Motion

cdef class BeltMotion:
    cdef readonly Py_ssize_t wheels
    cdef readonly Py_ssize_t points
    cdef readonly object modes
    cdef Py_ssize_t N
    cdef Py_ssize_t K
    cdef Py_ssize_t M
    cdef bint complete
    cdef double[::1] numbers
    cdef double[::1] table
    cdef double[::1] basis
    cdef double[::1] speed
    cdef double[::1] own
    cdef double[::1] rate
    cdef double[::1] frequency
    cdef double[::1] steady
    cdef double[::1] right
    cdef double[::1] left
    cdef double[::1] real
    cdef double[::1] imaginary
    cdef double[::1] shown
    cdef double[::1] rows
    cdef double[::1] shape
    cdef Py_ssize_t room
    cdef long long[::1] waiting
    cdef long long[::1] length
    cdef double[::1] inputs

    cdef void enqueue(
        self, Py_ssize_t wheel, long long length, double speed, double load, double traction
    ) noexcept nogil
    cdef void advance_queue(self, Py_ssize_t wheel) noexcept nogil
    cdef void change_speed(self, Py_ssize_t wheel, double speed) noexcept nogil
    cdef void interval(
        self, Py_ssize_t wheel, Py_ssize_t entry, double[::1] result, Py_ssize_t at
    ) noexcept nogil
    cdef void deflect(self, Py_ssize_t wheel, Motion motion) noexcept nogil
