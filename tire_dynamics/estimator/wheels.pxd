# cython: language_level=3

from .belt cimport BeltMotion
from .motion cimport Motion
from .road_motion cimport RoadMotion
from .schedule cimport Schedule

cdef class Wheels:
    cdef readonly Py_ssize_t count
    cdef readonly str model
    cdef readonly Schedule schedule
    cdef readonly Motion motion
    cdef readonly BeltMotion belt
    cdef readonly RoadMotion road
    cdef readonly bint on_road
    cdef Py_ssize_t n_max
    cdef double max_road_step
    cdef readonly long long clock_resets
    cdef bint has_time
    cdef long long now
    cdef long long input_timeout
    cdef double max_speed
    cdef double max_load
    cdef long long ring_period
    cdef long long[::1] offset
    cdef long long[::1] turn
    cdef long long[::1] has_turn
    cdef long long[::1] due
    cdef double[::1] force
    cdef bint is_noting
    cdef long long[::1] noted
    cdef double[::1] last_angle
    cdef double[::1] orders
    cdef public bint judged_elsewhere
    cdef double[::1] asked_at
    cdef double[::1] stable_at

    cdef bint stamped(self, Py_ssize_t wheel, long long received, long long stamp) noexcept nogil
    cdef void take_speed(
        self, Py_ssize_t wheel, long long received, long long stamp, double speed, double angle
    ) noexcept nogil
    cdef void take_load(
        self, Py_ssize_t wheel, long long received, long long stamp, double load, double traction
    ) noexcept nogil
    cdef void take_height(
        self, Py_ssize_t wheel, long long received, long long stamp, double height
    ) noexcept nogil
    cdef bint axle_force_and_norm(self, Py_ssize_t wheel, double speed) noexcept nogil
    cdef void deflect(self, Py_ssize_t wheel) noexcept nogil
    cdef void go_to(self, long long stamp) noexcept nogil
    cdef void follow(self, Py_ssize_t wheel, long long stamp) noexcept nogil
    cdef void start_if(self, Py_ssize_t wheel, int flags) noexcept nogil
    cdef void note_order(self, Py_ssize_t wheel) noexcept nogil
    cdef bint is_due(self, Py_ssize_t wheel) noexcept nogil
