# cython: language_level=3

cdef class FieldReader:
    cdef readonly Py_ssize_t count
    cdef readonly double[::1] values
    cdef readonly unsigned char[::1] found
    cdef readonly long long stamp
    cdef readonly bint has_stamp
    cdef readonly Py_ssize_t read_count
    cdef long long[::1] begin
    cdef long long[::1] slots
    cdef long long[::1] required
    cdef long long[::1] steps
    cdef long long[::1] table
    cdef long long[::1] name_begin
    cdef long long[::1] place
    cdef long long[::1] late
    cdef unsigned char[::1] known
    cdef long long[::1] known_begin
    cdef object _names
    cdef object _blocks
    cdef long long[::1] counts
    cdef bint swap
    cdef Py_ssize_t message
    cdef Py_ssize_t late_count
    cdef long long names_count
    cdef Py_ssize_t required_found

    cdef int take(
        self, Py_ssize_t number, const unsigned char[::1] data, Py_ssize_t first, Py_ssize_t size
    ) noexcept nogil
    cdef Py_ssize_t run(
        self, Py_ssize_t row, Py_ssize_t end, long long element, const unsigned char[::1] data, Py_ssize_t first,
        Py_ssize_t at, Py_ssize_t size
    ) noexcept nogil
    cdef Py_ssize_t over_names(
        self, const unsigned char[::1] data, Py_ssize_t first, Py_ssize_t at, Py_ssize_t size, long long count
    ) noexcept nogil
    cdef double number(self, long long kind, const unsigned char[::1] data, Py_ssize_t at) noexcept nogil
    cdef long long integer(
        self, Py_ssize_t size, bint is_signed, const unsigned char[::1] data, Py_ssize_t at
    ) noexcept nogil
    cdef void put(self, long long slot, double value, bint is_required) noexcept nogil

cdef bint same_bytes(
    const unsigned char[::1] data, Py_ssize_t first, unsigned char[::1] known, Py_ssize_t begin, Py_ssize_t size
) noexcept nogil
