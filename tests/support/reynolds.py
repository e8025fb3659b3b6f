"""Reynolds' equation of a journal bearing, solved by SciPy: what films are compared with.

In units of the bearing's radius, the clearance and the viscosity, with the journal's offset x over
the clearance and its rate u in axes that turn with half the sum of the spins. The height at the
angle a is h = 1 - x.n(a), its rate -u.n(a).
"""

import numpy as np
from scipy import sparse
from scipy.integrate import quad
from scipy.sparse.linalg import spsolve


def short_bearing_force(offset, rate):
    """Force on the journal, (2,), in mu R L^3/c^2: positive pressures of flow along the axis."""
    toward = np.arctan2(rate[1], rate[0])

    def density(angle, part):
        normal = np.array([np.cos(angle), np.sin(angle)])
        height = 1.0 - offset @ normal
        return -(rate @ normal) / height**3 * normal[part]

    ends = toward - 0.5 * np.pi, toward + 0.5 * np.pi
    deepest = np.arctan2(offset[1], offset[0])
    inside = [deepest + turn for turn in (-2 * np.pi, 0.0, 2 * np.pi)]
    inside = [angle for angle in inside if ends[0] < angle < ends[1]] or None
    options = {"epsabs": 0.0, "epsrel": 1e-11, "limit": 400, "points": inside}
    return np.array([quad(density, *ends, (part,), **options)[0] for part in (0, 1)])


def finite_bearing_force(width, offset, rate, around=180, along=16):
    """Force on the journal, (2,), in mu D B R^2/c^2, of a film of the width B over the diameter D
    that ruptures where its pressure would be negative: finite differences on half of the width."""
    angles = 2.0 * np.pi * np.arange(around) / around
    normals = np.stack([np.cos(angles), np.sin(angles)])
    middles = 2.0 * np.pi * (np.arange(around) + 0.5) / around
    cube = (1.0 - offset @ normals) ** 3
    cube_between = (1.0 - offset @ np.stack([np.cos(middles), np.sin(middles)])) ** 3
    step, reach = 2.0 * np.pi / around, width / along
    ahead = sparse.diags(cube_between) @ (_shift(around) - sparse.identity(around))
    around_part = (ahead - _shift(around).T @ ahead) / step**2
    across = sparse.diags([np.ones(along - 1), -2 * np.ones(along), np.ones(along - 1)], [-1, 0, 1])
    across = across.tolil()
    across[0, 1] = 2.0  # symmetric about the middle plane; zero pressure beyond the last node
    operator = sparse.kron(sparse.identity(along), around_part)
    operator = (operator + sparse.kron(across / reach**2, sparse.diags(cube))).tocsr()
    pressure = _ruptured(operator, np.tile(-12.0 * (rate @ normals), along)).reshape(along, around)
    weights = np.full(along, reach)
    weights[0] *= 0.5
    return -(normals * (weights @ pressure)).sum(axis=1) * step / (2.0 * width)


def _shift(count):
    """Takes each value from the next place around."""
    return sparse.csr_array(np.roll(np.eye(count), 1, axis=1))


def _ruptured(operator, source):
    """Pressures p >= 0 with operator p = source where positive, by turns of an active set."""
    full, pressure = np.ones(source.size, bool), np.zeros(source.size)
    for _ in range(100):
        pressure[:] = 0.0
        pressure[full] = spsolve(operator[full][:, full], source[full])
        wanted = np.where(full, pressure > 0.0, operator @ pressure > source)
        if (wanted == full).all():
            return pressure
        full = wanted
    raise RuntimeError("the film's edge was not found")
