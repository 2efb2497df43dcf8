# cython: language_level=3

cdef void grow(
    Py_ssize_t count, Py_ssize_t first, double[::1] rate, double[::1] angle, double time, double[::1] real, double[::1] imaginary
) noexcept nogil
