# cython: language_level=3

cdef void mode_eigensystem(
    Py_ssize_t count, double[::1] table, double speed, Py_ssize_t wheel, double[::1] rate, double[::1] frequency,
    double[::1] steady, double[::1] right, double[::1] left
) noexcept nogil
cdef double twist_at(double[::1] table, Py_ssize_t mode, double square) noexcept nogil
cdef double stretch_at(double[::1] table, Py_ssize_t mode, double square) noexcept nogil
