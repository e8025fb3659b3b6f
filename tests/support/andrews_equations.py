"""Andrews' squeezer by the equations of E. Hairer, G. Wanner, Solving Ordinary Differential
Equations II, section VII.7: seven angles, six loop equations, differentiated twice."""

import numpy as np
from numpy import cos, sin
from scipy.integrate import solve_ivp

START = (
    -0.0617138900142764496358948458001,
    0.0,
    0.455279819163070380255912382449,
    0.222668390165885884674473185609,
    0.487364979543842550225598953530,
    -0.222668390165885884674473185609,
    1.23054744454982119249735015568,
)
"""beta, theta, gamma, phi, delta, omega and epsilon, rad."""
PUBLISHED = (
    15.81077119629904,
    -15.75637105984298,
    0.04082224013073101,
    -0.5347301163226948,
    0.5244099658805304,
    0.5347301163226948,
    1.048080741042263,
)
"""The same after 0.03 s, by PSIDE at 1e-14 (Test Set for Initial Value Problem Solvers)."""
_m1, _m2, _m3, _m4, _m5, _m6, _m7 = 0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498
_i1, _i2, _i3, _i4 = 2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7
_i5, _i6, _i7 = 1.169e-5, 5.667e-7, 1.912e-5
_xb, _yb, _xc, _yc = -0.03635, 0.03273, 0.014, 0.072
_d, _da, _e, _ea, _rr, _ra = 0.028, 0.0115, 0.02, 0.01421, 0.007, 0.00092
_ss, _sa, _sb, _sc, _sd = 0.035, 0.01874, 0.01043, 0.018, 0.02
_ta, _tb, _u, _ua, _ub = 0.02308, 0.00916, 0.04, 0.01228, 0.00449
_zf, _zt, _fa = 0.02, 0.04, 0.01421
_c0, _l0, _torque = 4530.0, 0.07785, 0.033


def angles(time: float, tolerance: float) -> np.ndarray:
    """The seven angles after a time, s, by SciPy's DOP853."""
    start = np.concatenate([START, np.zeros(7)])
    path = solve_ivp(_rates, (0.0, time), start, "DOP853", rtol=tolerance, atol=tolerance)
    return path.y[:7, -1]


def _rates(t: float, y: np.ndarray) -> np.ndarray:
    angles, speeds = y[:7], y[7:]
    loops, bias = _loops(angles, speeds)
    matrix = np.block([[_mass(angles), loops.T], [loops, np.zeros((6, 6))]])
    loads = np.concatenate([_loads(angles, speeds), -bias])
    return np.concatenate([speeds, np.linalg.solve(matrix, loads)[:7]])


def _mass(angles: np.ndarray) -> np.ndarray:
    _, th, _, ph, _, om, _ = angles
    m, e, z = np.zeros((7, 7)), _e - _ea, _zf - _fa
    m[0, 0] = _m1 * _ra**2 + _m2 * (_rr**2 - 2 * _da * _rr * cos(th) + _da**2) + _i1 + _i2
    m[1, 0] = m[0, 1] = _m2 * (_da**2 - _da * _rr * cos(th)) + _i2
    m[1, 1] = _m2 * _da**2 + _i2
    m[2, 2] = _m3 * (_sa**2 + _sb**2) + _i3
    m[3, 3] = _m4 * e**2 + _i4
    m[4, 3] = m[3, 4] = _m4 * (e**2 + _zt * e * sin(ph)) + _i4
    m[4, 4] = _m4 * (_zt**2 + 2 * _zt * e * sin(ph) + e**2) + _m5 * (_ta**2 + _tb**2) + _i4 + _i5
    m[5, 5] = _m6 * z**2 + _i6
    m[6, 5] = m[5, 6] = _m6 * (z**2 - _u * z * sin(om)) + _i6
    m[6, 6] = _m6 * (z**2 - 2 * _u * z * sin(om) + _u**2) + _m7 * (_ua**2 + _ub**2) + _i6 + _i7
    return m


def _loads(angles: np.ndarray, speeds: np.ndarray) -> np.ndarray:
    _, th, ga, ph, _, om, _ = angles
    be_p, th_p, _, ph_p, de_p, om_p, ep_p = speeds
    xd = _sd * cos(ga) + _sc * sin(ga) + _xb
    yd = _sd * sin(ga) - _sc * cos(ga) + _yb
    length = np.hypot(xd - _xc, yd - _yc)
    force = -_c0 * (length - _l0) / length
    fx, fy = force * (xd - _xc), force * (yd - _yc)
    on_gamma = fx * (_sc * cos(ga) - _sd * sin(ga)) + fy * (_sd * cos(ga) + _sc * sin(ga))
    arm, crank = _m4 * _zt * (_e - _ea) * cos(ph), _m2 * _da * _rr * sin(th)
    leg = _m6 * _u * (_zf - _fa) * cos(om)
    return np.array(
        [
            _torque - crank * th_p * (th_p + 2 * be_p),
            crank * be_p**2,
            on_gamma,
            arm * de_p**2,
            -arm * ph_p * (ph_p + 2 * de_p),
            -leg * ep_p**2,
            leg * om_p * (om_p + 2 * ep_p),
        ]
    )


def _loops(angles: np.ndarray, speeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The Jacobian of the loops, and their second derivative at constant speeds."""
    be, th, ga, ph, de, om, ep = angles
    be_p, th_p, ga_p, ph_p, de_p, om_p, ep_p = speeds
    g, rod, four, six = np.zeros((6, 7)), be + th, ph + de, om + ep
    g[0::2, 0], g[0::2, 1] = -_rr * sin(be) + _d * sin(rod), _d * sin(rod)
    g[1::2, 0], g[1::2, 1] = _rr * cos(be) - _d * cos(rod), -_d * cos(rod)
    g[0, 2], g[1, 2] = -_ss * cos(ga), -_ss * sin(ga)
    g[2, 3:5] = -_e * cos(four), -_e * cos(four) + _zt * sin(de)
    g[3, 3:5] = -_e * sin(four), -_e * sin(four) - _zt * cos(de)
    g[4, 5:7] = _zf * sin(six), _zf * sin(six) - _u * cos(ep)
    g[5, 5:7] = -_zf * cos(six), -_zf * cos(six) - _u * sin(ep)
    rod_2, four_2, six_2 = (be_p + th_p) ** 2, (ph_p + de_p) ** 2, (om_p + ep_p) ** 2
    x = -_rr * cos(be) * be_p**2 + _d * cos(rod) * rod_2
    y = -_rr * sin(be) * be_p**2 + _d * sin(rod) * rod_2
    bias = [
        x + _ss * sin(ga) * ga_p**2,
        y - _ss * cos(ga) * ga_p**2,
        x + _e * sin(four) * four_2 + _zt * cos(de) * de_p**2,
        y - _e * cos(four) * four_2 + _zt * sin(de) * de_p**2,
        x + _zf * cos(six) * six_2 + _u * sin(ep) * ep_p**2,
        y + _zf * sin(six) * six_2 - _u * cos(ep) * ep_p**2,
    ]
    return g, np.array(bias)
