# C types of servo_periods.py, read by the compiler only.

from simulator.motor_laws cimport MotorLaws
from simulator.sensors cimport Sensors
from simulator.servo cimport Servo
from simulator.two_masses cimport TwoMasses

cdef class ServoPeriods:
    cdef Servo _servo
    cdef Sensors _sensors
    cdef TwoMasses _masses
    cdef MotorLaws _laws
    cdef double[::1] _torque_constant, _current

    cpdef int begin(self) except -1
    cpdef int advance(self, Py_ssize_t steps, object touch) except -1
    cdef void _drive(self) noexcept
    cpdef int run(self, Py_ssize_t periods, Py_ssize_t steps, object touch) except -1
    cpdef int record(
        self,
        double[:, ::1] external,
        Py_ssize_t steps,
        double[:, ::1] phi,
        double[:, ::1] gear_torque,
    ) except -1
