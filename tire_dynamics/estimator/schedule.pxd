# cython: language_level=3

cdef class Schedule:
    cdef readonly Py_ssize_t wheels
    cdef readonly long long timeout
    cdef long long[::1] time
    cdef long long[::1] has_time
    cdef long long[::1] running
    cdef long long[::1] diverged
    cdef long long[::1] stops
    cdef long long[::1] divergences
    cdef long long[::1] counts
    cdef double[::1] measured_angle
    cdef long long[::1] angle_used
    cdef long long[::1] has
    cdef long long[::1] stamp
    cdef double[::1] values
    cdef Py_ssize_t room
    cdef long long[::1] waiting
    cdef long long[::1] waiting_stamp
    cdef double[::1] waiting_values
    cdef long long[::1] cursor
    cdef public long long length
    cdef public double speed
    cdef public double load
    cdef public double traction
    cdef public double load_after
    cdef public double angle

    cdef void forget(self, Py_ssize_t wheel) noexcept nogil
    cdef bint is_full(self, Py_ssize_t wheel, Py_ssize_t kind) noexcept nogil
    cdef int put(self, Py_ssize_t wheel, Py_ssize_t kind, long long stamp, double first, double second) noexcept nogil
    cdef int put_speed(self, Py_ssize_t wheel, long long stamp, double speed, double angle) noexcept nogil
    cdef void let_in(self, Py_ssize_t wheel, Py_ssize_t kind) noexcept nogil
    cdef long long expiry(self, Py_ssize_t wheel) noexcept nogil
    cdef int may_start(self, Py_ssize_t wheel, long long moment) noexcept nogil
    cdef void start(self, Py_ssize_t wheel) noexcept nogil
    cdef double newest_load(self, Py_ssize_t wheel) noexcept nogil
    cdef double angle_at(self, Py_ssize_t wheel, long long moment, bint again) noexcept nogil
    cdef int begin(self, Py_ssize_t wheel, long long stamp) noexcept nogil
    cdef int proceed(self, Py_ssize_t wheel, long long stamp) noexcept nogil
