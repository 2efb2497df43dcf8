# cython: language_level=3

from .belt cimport BeltMotion
from .motion cimport Motion

cdef class RoadMotion:
    cdef readonly Motion motion
    cdef readonly BeltMotion belt
    cdef readonly object unit
    cdef readonly tuple loads
    cdef object _angles
    cdef readonly Py_ssize_t wheels
    cdef readonly Py_ssize_t points
    cdef Py_ssize_t N
    cdef Py_ssize_t K
    cdef Py_ssize_t M
    cdef Py_ssize_t H
    cdef Py_ssize_t half
    cdef Py_ssize_t runouts
    cdef bint complete
    cdef bint sprung
    cdef bint heavy
    cdef bint rigid
    cdef bint varying
    cdef bint winding
    cdef Py_ssize_t most_coupled
    cdef Py_ssize_t coupled
    cdef Py_ssize_t uneven
    cdef Py_ssize_t rounds
    cdef double on_wheel
    cdef double on_fore
    cdef double held_mass
    cdef double part_begin
    cdef double part
    cdef double[::1] pushed
    cdef double[::1] ahead
    cdef double[::1] way
    cdef double[::1] edge_height
    cdef double[::1] knots
    cdef long long[::1] knot
    cdef long long[::1] known
    cdef double radius
    cdef double reach_of_patch
    cdef double[::1] variation
    cdef double[::1] wave
    cdef double[::1] angle
    cdef double[::1] net
    cdef double[::1] pull
    cdef double[::1] pull_begin
    cdef double[::1] pull_end
    cdef double[::1] push_of
    cdef double[::1] kept
    cdef double k_s
    cdef double c_s
    cdef double heft
    cdef double size
    cdef double size_spin
    cdef double stiffness
    cdef double damping
    cdef double lagging
    cdef double matrix_at
    cdef double whole_begin
    cdef double whole_end
    cdef double whole_mean
    cdef double curve
    cdef double[::1] own
    cdef double[::1] rest_own
    cdef double[::1] forces
    cdef double[::1] before
    cdef double[::1] road
    cdef double[::1] base
    cdef double[::1] lift
    cdef double[::1] first
    cdef double[::1] weight
    cdef double[::1] first_weight
    cdef double[::1] origin
    cdef double[::1] contact
    cdef double[::1] table_length
    cdef double[::1] growth
    cdef double[::1] phi_1
    cdef double[::1] phi_2
    cdef double[::1] phi_3
    cdef double[::1] from_a
    cdef double[::1] from_b
    cdef double[::1] end_seen
    cdef double[::1] mean_seen
    cdef double[::1] ends_a
    cdef double[::1] ends_b
    cdef double[::1] means_a
    cdef double[::1] means_b
    cdef double[::1] law
    cdef double[::1] factored
    cdef double[::1] mean_a
    cdef double[::1] mean_b
    cdef double[::1] felt
    cdef double[::1] moved_end
    cdef double[::1] moved_mean
    cdef double[::1] inverse
    cdef double[::1] static
    cdef double[::1] factorial
    cdef double[::1] real
    cdef double[::1] imaginary
    cdef double[::1] answer
    cdef double[::1] lags
    cdef double[::1] Z_end
    cdef double[::1] Z_mean
    cdef double[::1] end
    cdef double[::1] mid
    cdef double[::1] D_end
    cdef double[::1] D_mean
    cdef double[::1] alpha
    cdef double[::1] beta
    cdef double[::1] slope
    cdef double[::1] rises
    cdef double[::1] right_side
    cdef double[::1] unknown
    cdef double[::1] least
    cdef double[::1] reduced
    cdef double[::1] z
    cdef double[::1] rest
    cdef double[::1] speed
    cdef double[::1] system
    cdef double[::1] spin
    cdef double[::1] input
    cdef double[::1] imbalance
    cdef double[::1] output
    cdef double[::1] matrix
    cdef double[::1] chain
    cdef double[::1] moved
    cdef double[::1] after
    cdef double[::1] forced
    cdef double[::1] forced_mean
    cdef double[::1] small
    cdef double[::1] gap
    cdef double[::1] tangents
    cdef double[::1] share
    cdef double[::1] cosines
    cdef double[::1] whole
    cdef double[::1] turned
    cdef double[::1] push
    cdef double[::1] seen
    cdef double[::1] lag
    cdef double[::1] soft
    cdef double[::1] runout
    cdef double[::1] angles
    cdef double[::1] none
    cdef double[::1] c
    cdef double[::1] s
    cdef double[::1] reach
    cdef long long[::1] touching
    cdef long long[::1] order
    cdef long long[::1] reduced_order
    cdef long long[::1] active
    cdef long long[::1] some

    cdef void rest_at(self, Py_ssize_t wheel) noexcept nogil
    cdef void amplitudes(self, Py_ssize_t wheel, double[::1] own) noexcept nogil
    cdef void displacements_at_points(self, bint mean) noexcept nogil
    cdef void set_before(self, Py_ssize_t wheel) noexcept nogil
    cdef void change_speed(self, Py_ssize_t wheel, double speed) noexcept nogil
    cdef void tabulate_step(self, Py_ssize_t wheel, Py_ssize_t slot, double length) noexcept nogil
    cdef double end_response(self, Py_ssize_t slot, Py_ssize_t which, Py_ssize_t i, Py_ssize_t j) noexcept nogil
    cdef double mean_response(self, Py_ssize_t slot, Py_ssize_t which, Py_ssize_t i, Py_ssize_t j) noexcept nogil
    cdef void set_matrix(self, Py_ssize_t wheel) noexcept nogil
    cdef Py_ssize_t order_of(self, Py_ssize_t wheel, double length) noexcept nogil
    cdef void next_row(self, Py_ssize_t row, double part, bint force) noexcept nogil
    cdef void unit_responses(self, Py_ssize_t wheel, Py_ssize_t slot, double length) noexcept nogil
    cdef void set_contact_conditions(self, Py_ssize_t slot, double length) noexcept nogil
    cdef void free_deflection(
        self, Py_ssize_t wheel, Py_ssize_t slot, double length, double phase, double traction, double traction_change
    ) noexcept nogil
    cdef void traction_response(
        self, Py_ssize_t wheel, Py_ssize_t slot, double length, double traction, double traction_change
    ) noexcept nogil
    cdef double solve_contact(self, Py_ssize_t wheel, Py_ssize_t slot, double length) noexcept nogil
    cdef void solve_complementarity(self, Py_ssize_t slot) noexcept nogil
    cdef void finish_step(self, Py_ssize_t wheel, Py_ssize_t slot) noexcept nogil
    cdef double try_part(
        self, Py_ssize_t wheel, double done, double t, bint touching, double length, double phase, double traction,
        double traction_change
    ) noexcept nogil
    cdef double rate(self, Py_ssize_t wheel, Py_ssize_t slot, double least) noexcept nogil
    cdef void parts(
        self, Py_ssize_t wheel, double length, double phase, double traction, double traction_change
    ) noexcept nogil
    cdef void step(self, Py_ssize_t wheel, double length, double traction, double traction_change) noexcept nogil
    cdef void press(self, Py_ssize_t wheel) noexcept nogil
    cdef void whole_step(
        self, Py_ssize_t wheel, double length, double phase, double traction, double traction_change
    ) noexcept nogil
    cdef void save_or_restore(self, Py_ssize_t wheel, bint back) noexcept nogil
    cdef void sidewall_pull(self, Py_ssize_t wheel, double phase, double[::1] pull) noexcept nogil
    cdef void net_of(self, Py_ssize_t wheel) noexcept nogil
    cdef void pull_on_first_mode(self) noexcept nogil
    cdef double pull_of_part(self, Py_ssize_t k, double here, bint change) noexcept nogil
    cdef void pull_on_belt(self, Py_ssize_t wheel, Py_ssize_t slot, double length) noexcept nogil
    cdef void set_road_and_runout(self, Py_ssize_t wheel, double speed, double length) noexcept nogil
    cdef double pieces_of(self, Py_ssize_t wheel, double seconds, double speed) noexcept nogil
    cdef void advance_wheel(
        self, Py_ssize_t wheel, double seconds, double speed, double height, double angle
    ) noexcept nogil
    cdef void extend_profile(self, Py_ssize_t wheel, double move, double height) noexcept nogil
    cdef void add_knot(self, Py_ssize_t wheel, bint forward, double place, double height) noexcept nogil
    cdef double height_at(self, Py_ssize_t wheel, double place) noexcept nogil
    cdef void mark_diverged(self, Py_ssize_t wheel) noexcept nogil
    cdef void publish_now(self, Py_ssize_t wheel) noexcept nogil
    cdef bint axle_force_and_norm(self, Py_ssize_t wheel, double speed) noexcept nogil
    cdef void set_belt(self, Py_ssize_t wheel) noexcept nogil
