# cython: language_level=3

cdef class Motion:
    cdef readonly Py_ssize_t wheels
    cdef readonly Py_ssize_t states
    cdef readonly str model
    cdef readonly object unit
    cdef readonly object parts
    cdef Py_ssize_t half
    cdef Py_ssize_t pairs
    cdef Py_ssize_t harmonics
    cdef bint rotating
    cdef bint varying
    cdef bint rigid
    cdef bint complete
    cdef double highest
    cdef double[::1] state
    cdef double[::1] phase
    cdef double[::1] spin_speed
    cdef double[::1] system
    cdef double[::1] spin
    cdef double[::1] input
    cdef double[::1] pull
    cdef double[::1] net
    cdef double[::1] spring
    cdef double[::1] imbalance
    cdef double[::1] sizes
    cdef double[::1] wheel_x
    cdef double[::1] output
    cdef double[::1] output_spin
    cdef double[::1] matrix
    cdef double[::1] matrix_at
    cdef double[::1] between
    cdef double[::1] after
    cdef double[::1] force
    cdef double[::1] terms
    cdef double[::1] pulls
    cdef double[::1] reach
    cdef double[::1] convolved
    cdef double[::1] answers
    cdef double[::1] cosines
    cdef double[::1] sines
    cdef double[::1] angles
    cdef double[::1] none
    cdef double[::1] affine
    cdef double[::1] squared
    cdef public double force_x
    cdef public double force_z

    cdef void set_matrix(self, double[::1] matrix, Py_ssize_t at, double speed) noexcept nogil
    cdef void spin_at(self, Py_ssize_t wheel, double speed) noexcept nogil
    cdef void jump(self, Py_ssize_t wheel, double change) noexcept nogil
    cdef void step(
        self, Py_ssize_t wheel, double seconds, double speed, double speed_change, double load, double traction,
        double load_change, double traction_change, double angle
    ) noexcept nogil
    cdef void taylor_step(
        self, double[::1] matrix, Py_ssize_t at, Py_ssize_t order, double length, double slope, double load,
        double traction, double load_change, double traction_change
    ) noexcept nogil
    cdef void rotating_taylor_step(
        self, double[::1] matrix, Py_ssize_t at, Py_ssize_t order, double length, double speed, double slope,
        double phase, double load, double traction, double load_change, double traction_change
    ) noexcept nogil
    cdef Py_ssize_t order_of(self, double reach) noexcept nogil
    cdef void next_term(
        self, double[::1] matrix, Py_ssize_t at, Py_ssize_t k, double part, Py_ssize_t first
    ) noexcept nogil
    cdef void add_slope(self, Py_ssize_t k, double part, double slope, double length) noexcept nogil
    cdef void sum_terms(self, Py_ssize_t order) noexcept nogil
    cdef void long_step(
        self, Py_ssize_t wheel, double seconds, double load, double traction, double load_change,
        double traction_change, double norm
    ) noexcept nogil
    cdef bint axle_force_and_norm(self, Py_ssize_t wheel, double speed) noexcept nogil
