"""The paper's double pendulum written with SciPy.

The model is that of `clearjoint.mechanisms.double_pendulum`, written independently (Flores et al.
2006, section 6, Tables 1 and 2): arm 2 hangs on the ground by a joint with clearance (axis Z, bases
V and W, no friction, no axial stop, Lankarani and Nikravesh's law with Ravn's stiffness), and arm 3
on arm 2 by an ideal revolute joint about X. There are 26 states in absolute coordinates: positions
and Euler parameters of both arms, then velocities and spins in body axes. The hinge has five
constraint rows with multipliers and Baumgarte's terms (eq. 32).

Each base is either in flight or in contact. The force follows this mode, not the sign of the gap,
so that the integrator sees no discontinuity within a step of `DOP853`. If an accepted step ends
with a base in flight inside the wall, the onset is found on the dense output of the step, the entry
speed is stored, and the integration restarts from the onset, as with terminal events of
`solve_ivp`. At separation the force fades to zero, so the mode changes only at the end of that
step.

Against the event-exact reference (c 0.5 mm, e 0.9), errors of r2 at 0.1 s are 9e-7, 6e-8, 6e-8 and
2e-12 m for rtol 1e-6, 1e-8, 1e-10 and 1e-12 (atol = rtol/100). The error estimate is sometimes
wrong in the step across a separation, where the force has no second derivative.
"""

import time
from dataclasses import dataclass

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import root_scalar


@dataclass(frozen=True)
class BaselineRun:
    """Final state and cost of a run.

    - `r2`, `r3`: final centres of mass of the arms, (3,) m.
    - `steps`: accepted steps.
    - `right_hand_sides`: evaluations of the equations of motion, or of their residual by an
      implicit method.
    - `seconds`: wall time of the integration without preparation.
    """

    r2: np.ndarray
    r3: np.ndarray
    steps: int
    right_hand_sides: int
    seconds: float


MASS = 7.02
"""Mass of each arm, kg (Table 1)."""
SLENDER, BROAD = 0.0010, 0.5855
"""Moments of inertia about the axis of the rod and across it, kg m^2 (Table 1)."""
GRAVITY = np.array([0.0, 9.81, 0.0])
"""Gravity, m/s^2."""
BEARING_RADIUS, JOURNAL_LENGTH = 10e-3, 20e-3
"""Bearing radius and journal length, m."""
YOUNG_MODULUS, POISSON_RATIO = 207e9, 0.3
"""Young's modulus, Pa, and Poisson's ratio of both surfaces (Table 2)."""
ALPHA, BETA = 5.0, 5.0
"""Baumgarte's parameters, 1/s; the paper gives none, 5 is the usual choice of its authors."""
MAX_STEP = 5e-4
"""Largest step, s; a longer step in flight could miss a short contact."""
TOUCH = 1e-14
"""Gaps below this are rounding, m: bases that touch at once enter contact together."""

_INERTIA = np.array([[SLENDER, BROAD, BROAD], [BROAD, BROAD, SLENDER]])
_INVERSE_MASS = 1.0 / np.hstack([np.full((2, 3), MASS), _INERTIA]).ravel()
_HALF = 0.5 * JOURNAL_LENGTH
_MARKS = np.array(  # per arm, columns: V, W, hinge, axis X; then hinge, axis Y, axis Z, nothing
    [
        [[-0.5, -0.5, 0.5, 1.0], [0.0, 0.0, 0.0, 0.0], [-_HALF, _HALF, 0.0, 0.0]],
        [[0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [-0.5, 0.0, 1.0, 0.0]],
    ]
)
_V, _W, _HINGE_2, _X = range(4)
_HINGE_3, _Y, _Z = range(3)


def _skew_basis() -> np.ndarray:
    """Return the (3, 9) array B for which w @ B is the flattened matrix of w x."""
    basis = np.zeros((3, 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        basis[i, k, j], basis[i, j, k] = 1.0, -1.0
    return basis.reshape(3, 9)


def _euler_basis() -> np.ndarray:
    """Return the (4, 24) array B for which p @ B are the flattened matrices G and L, (2, 3, 4)."""
    basis = np.zeros((4, 2, 3, 4))
    skew = _skew_basis().reshape(3, 3, 3)
    for i in range(3):
        basis[i + 1, :, i, 0] = -1.0
        basis[0, :, i, i + 1] = 1.0
        basis[i + 1, 0, :, 1:] = skew[i]
        basis[i + 1, 1, :, 1:] = -skew[i]
    return basis.reshape(4, 24)


_SKEW = _skew_basis()
_EULER = _euler_basis()
_SKEW_HINGE = [(_MARKS[i, :, j] @ _SKEW).reshape(3, 3) for i, j in ((0, _HINGE_2), (1, _HINGE_3))]
_SKEW_X, _SKEW_Y, _SKEW_Z = (axis.reshape(3, 3) for axis in _SKEW)
_JACOBIAN = np.zeros((5, 12))
_JACOBIAN[:3, 0:3], _JACOBIAN[:3, 6:9] = -np.eye(3), np.eye(3)


@dataclass(frozen=True)
class Contact:
    """Clearance joint: radial `clearance` m, `stiffness` N/m^1.5, LN `damping` factor, 1."""

    clearance: float
    stiffness: float
    damping: float


def ravn_contact(clearance: float, restitution: float, young: float = YOUNG_MODULUS) -> Contact:
    """Return the contact with Ravn's stiffness for steel, and Lankarani and Nikravesh's damping."""
    compliance = 2.0 * (1.0 - POISSON_RATIO**2) / young
    radius = BEARING_RADIUS * (BEARING_RADIUS - clearance) / clearance
    stiffness = 4.0 / (3.0 * compliance) * np.sqrt(radius)
    return Contact(clearance, stiffness, 0.75 * (1.0 - restitution**2))


@dataclass(frozen=True)
class _Motion:
    """Quantities of both arms.

    Nikravesh's L (2, 3, 4); A, its rate and the matrix of the spin (2, 3, 3); the columns of
    `_MARKS` in global axes from the centre of mass, m, and their rates, m/s.
    """

    l: np.ndarray
    a: np.ndarray
    a_rate: np.ndarray
    spin: np.ndarray
    marks: np.ndarray
    rates: np.ndarray


def _motion(y: np.ndarray) -> _Motion:
    p = y[:14].reshape(2, 7)[:, 3:]
    w = y[14:].reshape(2, 6)[:, 3:]
    both = (p @ _EULER).reshape(2, 2, 3, 4)
    g, l = both[:, 0], both[:, 1]
    a = g @ l.transpose(0, 2, 1) / (p * p).sum(axis=1)[:, None, None]
    spin = (w @ _SKEW).reshape(2, 3, 3)
    a_rate = a @ spin
    return _Motion(l, a, a_rate, spin, a @ _MARKS, a_rate @ _MARKS)


def _gaps(y: np.ndarray, motion: _Motion, clearance: float) -> tuple[np.ndarray, ...]:
    """Return depth and rate of both bases, (2,) m and m/s, and the outward normals, (2, 2)."""
    centre = y[:2, None] + motion.marks[0, :2, :2]
    velocity = y[14:16, None] + motion.rates[0, :2, :2]
    distance = np.sqrt((centre * centre).sum(axis=0))
    normal = centre / np.maximum(distance, 1e-300)
    return distance - clearance, (normal * velocity).sum(axis=0), normal


def _contact_force(
    y: np.ndarray, motion: _Motion, entry: np.ndarray, contact: Contact
) -> np.ndarray:
    """Return force and moment on arm 2 in body axes, (6,) N and N m; `entry` is 0 in flight."""
    depth, rate, normal = _gaps(y, motion, contact.clearance)
    touching = (entry > 0.0) & (depth > 0.0)
    speed = np.where(touching, entry, 1.0)
    elastic = contact.stiffness * np.where(touching, depth, 0.0) ** 1.5
    size = elastic * np.maximum(1.0 + contact.damping * rate / speed, 0.0)
    force = -normal * size
    local = motion.a[0].T[:, :2] @ force
    arms = _MARKS[0, :, :2]
    moment = (arms.T @ _SKEW).reshape(2, 3, 3) @ local.T[:, :, None]
    return np.concatenate([force.sum(axis=1), [0.0], moment.sum(axis=(0, 2))])


def _constraints(y: np.ndarray, m: _Motion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return residuals (5,), Jacobian (5, 12) and acceleration bias (5,) of the hinge."""
    bias = m.a_rate @ m.spin @ _MARKS
    x, across = m.marks[0, :, _X], m.marks[1, :, _Y : _Z + 1].T
    x_rate, across_rate = m.rates[0, :, _X], m.rates[1, :, _Y : _Z + 1].T
    residual = np.empty(5)
    residual[:3] = y[7:10] + m.marks[1, :, _HINGE_3] - y[:3] - m.marks[0, :, _HINGE_2]
    residual[3:] = across @ x
    jacobian = _JACOBIAN.copy()
    jacobian[:3, 3:6] = m.a[0] @ _SKEW_HINGE[0]
    jacobian[:3, 9:12] = -m.a[1] @ _SKEW_HINGE[1]
    jacobian[3:, 3:6] = across @ m.a[0] @ -_SKEW_X
    x_in_3 = x @ m.a[1]
    jacobian[3, 9:12], jacobian[4, 9:12] = _SKEW_Y @ x_in_3, _SKEW_Z @ x_in_3
    acceleration = np.empty(5)
    acceleration[:3] = bias[1, :, _HINGE_3] - bias[0, :, _HINGE_2]
    acceleration[3:] = bias[1, :, _Y : _Z + 1].T @ x + across @ bias[0, :, _X]
    acceleration[3:] += 2.0 * (across_rate @ x_rate)
    return residual, jacobian, acceleration


def right_hand_side(t: float, y: np.ndarray, entry: np.ndarray, contact: Contact) -> np.ndarray:
    """Return the time derivative of the state.

    **Arguments:** time, s (unused); state (26,); entry speeds of V and W, (2,) m/s, zero in flight;
    parameters of the contact.
    """
    del t
    motion = _motion(y)
    u = y[14:]
    spin = u.reshape(2, 6)[:, 3:]
    load = np.empty((2, 6))
    load[:, :3] = MASS * GRAVITY
    load[:, 3:] = -(motion.spin @ (_INERTIA * spin)[:, :, None])[:, :, 0]
    if entry.any():
        load[0] += _contact_force(y, motion, entry, contact)
    free = _INVERSE_MASS * load.ravel()
    residual, jacobian, bias = _constraints(y, motion)
    wanted = -bias - 2.0 * ALPHA * (jacobian @ u) - BETA**2 * residual
    weighted = jacobian * _INVERSE_MASS
    multipliers = np.linalg.solve(weighted @ jacobian.T, wanted - jacobian @ free)
    rate = np.empty(26)
    q_rate = rate[:14].reshape(2, 7)
    q_rate[:, :3] = u.reshape(2, 6)[:, :3]
    q_rate[:, 3:] = 0.5 * (spin[:, None, :] @ motion.l)[:, 0]
    rate[14:] = free + multipliers @ weighted
    return rate


def initial_state() -> np.ndarray:
    """Return the state at rest with a centred journal and parallel frames, (26,)."""
    y = np.zeros(26)
    y[[0, 3, 7, 9, 10]] = 0.5, 1.0, 1.0, 0.5, 1.0
    return y


def depths_and_rates(y: np.ndarray, contact: Contact) -> tuple[np.ndarray, np.ndarray]:
    """Return penetrations (negative in flight) and their rates at V and W, (2,) m and m/s."""
    depth, rate, _ = _gaps(y, _motion(y), contact.clearance)
    return depth, rate


def _onset(solver: DOP853, contact: Contact, base: int) -> float:
    """Return the time at which `base` touched the wall within the last step of the solver, s."""
    path = solver.dense_output()

    def depth(t: float) -> float:
        return float(depths_and_rates(path(t), contact)[0][base])

    return root_scalar(depth, bracket=(solver.t_old, solver.t), xtol=1e-15).root


def run(
    duration: float,
    rtol: float,
    atol: float,
    clearance: float = 5e-4,
    restitution: float = 0.9,
    floor: float = 1e-6,
) -> BaselineRun:
    """Simulate from rest.

    **Arguments:** `duration`, s; `rtol` and `atol` of `scipy.integrate.DOP853`; radial `clearance`,
    m; requested `restitution`; `floor` of the entry speed, m/s.
    """
    contact = ravn_contact(clearance, restitution)
    entry = np.zeros(2)
    steps = evaluations = 0
    start = time.perf_counter()

    def begin(t: float, y: np.ndarray) -> DOP853:
        return DOP853(
            lambda t, y: right_hand_side(t, y, entry, contact),
            t,
            y,
            duration,
            max_step=MAX_STEP,
            rtol=rtol,
            atol=atol,
        )

    solver = begin(0.0, initial_state())
    while solver.status == "running":
        solver.step()
        steps += 1
        depth, _ = depths_and_rates(solver.y, contact)
        entry[depth <= 0.0] = 0.0
        struck = np.flatnonzero((entry == 0.0) & (depth > TOUCH))
        if struck.size:
            t = min(_onset(solver, contact, int(base)) for base in struck)
            state = solver.dense_output()(t)
            depth, rate = depths_and_rates(state, contact)
            touching = (entry == 0.0) & (depth > -TOUCH)
            entry[touching] = np.maximum(rate[touching], floor)
            evaluations += solver.nfev
            solver = begin(t, state)
    seconds = time.perf_counter() - start
    if solver.status == "failed":
        raise RuntimeError(f"DOP853 failed at t = {solver.t} s: reduce rtol or atol")
    evaluations += solver.nfev
    return BaselineRun(solver.y[:3], solver.y[7:10], steps, evaluations, seconds)
