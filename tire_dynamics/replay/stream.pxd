# cython: language_level=3

from ..cdr.field_reader cimport FieldReader
from ..estimator.wheels cimport Wheels

cdef class MessageStream:
    cdef readonly Wheels wheels
    cdef readonly long long no_velocity
    cdef readonly object joints
    cdef readonly object malformed
    cdef readonly list inputs
    cdef readonly list outputs
    cdef object _decoder
    cdef object _wrench_decoder
    cdef double radius
    cdef double scale
    cdef long long[::1] malformed_counts
    cdef unsigned char[::1] names
    cdef Py_ssize_t names_end
    cdef Py_ssize_t names_count
    cdef Py_ssize_t places
    cdef long long[::1] place
    cdef unsigned char[::1] wrench
    cdef unsigned char[::1] deflection
    cdef unsigned char[::1] shape
    cdef long long[::1] wrench_at
    cdef long long[::1] shape_at
    cdef double[::1] outward
    cdef double[::1] along
    cdef unsigned char[::1] out
    cdef Py_ssize_t used
    cdef long long[::1] begin
    cdef long long[::1] topic
    cdef Py_ssize_t messages
    cdef Py_ssize_t most
    cdef bint on_road
    cdef Py_ssize_t kinds
    cdef Py_ssize_t results
    cdef readonly FieldReader fields
    cdef object sink
    cdef bint offers
    cdef Py_ssize_t width
    cdef Py_ssize_t fixed
    cdef long long[::1] also
    cdef long long[::1] groups
    cdef long long[::1] group_begin
    cdef long long[::1] slot_wheel
    cdef long long[::1] partner
    cdef double[::1] scale_of
    cdef double[::1] shift_of
    cdef double[::1] last_speed
    cdef double[::1] last_traction
    cdef double[::1] spare
    cdef double[::1] sums
    cdef readonly long long[::1] empty_counts
    cdef readonly list mapped
    cdef object estimator
    cdef bint estimates
    cdef bint has_covariance
    cdef bint has_estimate
    cdef Py_ssize_t first_estimate
    cdef double[::1] estimated
    cdef double[::1] axle_variance
    cdef unsigned char[::1] number
    cdef unsigned char[::1] covariance

    cdef bint take(
        self, Py_ssize_t topic, long long received, const unsigned char[::1] data, Py_ssize_t first, Py_ssize_t size
    ) noexcept nogil
    cdef bint take_float(
        self, Py_ssize_t wheel, bint is_load, long long received, const unsigned char[::1] data, Py_ssize_t first,
        Py_ssize_t size
    ) noexcept nogil
    cdef int take_wrench(
        self, Py_ssize_t wheel, long long received, const unsigned char[::1] data, Py_ssize_t first, Py_ssize_t size
    ) noexcept nogil
    cdef int take_joints(
        self, long long received, const unsigned char[::1] data, Py_ssize_t first, Py_ssize_t size
    ) noexcept nogil
    cdef void put_forces(self, long long stamp, Py_ssize_t head) noexcept nogil
    cdef void put_wrench(
        self, Py_ssize_t wheel, Py_ssize_t topic, long long stamp, Py_ssize_t head, double x, double z
    ) noexcept nogil
    cdef void put_belts(self, long long stamp, Py_ssize_t head) noexcept nogil
    cdef bint take_mapped(
        self, Py_ssize_t number, long long received, const unsigned char[::1] data, Py_ssize_t first, Py_ssize_t size
    ) noexcept nogil
    cdef void take_group(
        self, Py_ssize_t group, long long received, long long stamp, Py_ssize_t first, Py_ssize_t count
    ) noexcept nogil
    cdef void note(self, Py_ssize_t quantity, Py_ssize_t place, double value) noexcept nogil
    cdef void offer(
        self, Py_ssize_t quantity, Py_ssize_t wheel, long long received, long long stamp
    ) noexcept nogil
    cdef void offer_one(self, Py_ssize_t wheel, long long received, double value) noexcept nogil
    cdef void estimate(self, long long stamp) noexcept nogil
    cdef void put_estimate(self, Py_ssize_t wheel, long long stamp, Py_ssize_t head) noexcept nogil
    cdef void put_bytes(self, unsigned char[::1] data, Py_ssize_t topic, Py_ssize_t head) noexcept nogil
