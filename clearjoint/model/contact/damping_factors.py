"""Hunt-Crossley laws, which differ in their damping factor chi for a requested restitution c.

The normal force is F = K delta^n (1 + chi v/v0), N, with the penetration delta, m, its rate v, m/s,
and the entry speed v0, m/s, which is the rate at the onset of the contact. `stiffness` is K, N/m^n,
and `exponent` is n, 1.5 unless a class says otherwise. chi is dimensionless.

`restitution` is c, the requested ratio of rebound speed to entry speed in a free impact. The actual
ratio follows from chi alone, and most of the published factors meet the request only approximately.
The examples print the ratio that a law delivers, which `delivered_restitution` computes.
`ExactRestitution` delivers the requested value. All arguments, and the values that are refused, are
described in `AbstractDampedLaw`.
"""

import equinox as eqx
import jax.numpy as jnp

from ...fields.cautions import LawRangeWarning, caution
from ...fields.checks import concrete
from ...math.vectors import Scalar
from .hunt_crossley import AbstractDampedLaw
from .laws import require_rebound
from .restitution import exact_damping_factor


class HuntCrossley(AbstractDampedLaw):
    r"""Law with the damping factor chi = 3 (1 - c)/2.

    Source: K. H. Hunt, F. R. E. Crossley 1975; D. W. Marhefka, D. E. Orin 1999.

    $$\chi = \frac{3 (1 - c)}{2}$$

    >>> law = cj.laws.HuntCrossley(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.3000, delivers 0.8329
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 3 (1 - c)/2."""
        return 1.5 * (1.0 - self.restitution)


class HerbertMcWhannell(AbstractDampedLaw):
    r"""Law with the damping factor chi = 6 (1 - c)/((2 c - 1)^2 + 3).

    Source: R. G. Herbert, D. C. McWhannell 1977.

    $$\chi = \frac{6 (1 - c)}{(2 c - 1)^2 + 3}$$

    >>> law = cj.laws.HerbertMcWhannell(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.3571, delivers 0.8070
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 6 (1 - c)/((2 c - 1)^2 + 3)."""
        return 6.0 * (1.0 - self.restitution) / ((2.0 * self.restitution - 1.0) ** 2 + 3.0)


class LeeWang(AbstractDampedLaw):
    r"""Law with the damping factor chi = 3 (1 - c)/4.

    Source: T. W. Lee, A. C. Wang 1983.

    $$\chi = \frac{3 (1 - c)}{4}$$

    Near c = 1 it dissipates half the energy that c requires. For c = 0 the rebound speed is still
    0.66 times the entry speed.

    >>> law = cj.laws.LeeWang(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.1500, delivers 0.9090
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 3 (1 - c)/4."""
        return 0.75 * (1.0 - self.restitution)


class LankaraniNikravesh(AbstractDampedLaw):
    r"""Law with the damping factor chi = 3 (1 - c^2)/4.

    Source: H. M. Lankarani, P. E. Nikravesh 1990; P. Flores et al. 2006, eq. 24.

    $$\chi = \frac{3 (1 - c^2)}{4}$$

    >>> law = cj.laws.LankaraniNikravesh(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.2700, delivers 0.8471
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 3 (1 - c^2)/4."""
        return 0.75 * (1.0 - self.restitution**2)


class ZhiyingQishao(AbstractDampedLaw):
    r"""Law with the damping factor chi = 3/4 (1 - c^2) exp(2 (1 - c)).

    Source: Q. Zhiying, L. Qishao 2006.

    $$\chi = \frac{3}{4} (1 - c^2) e^{2 (1 - c)}$$

    >>> law = cj.laws.ZhiyingQishao(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.4028, delivers 0.7874
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 3/4 (1 - c^2) exp(2 (1 - c))."""
        return 0.75 * (1.0 - self.restitution**2) * jnp.exp(2.0 * (1.0 - self.restitution))


class CarvalhoMartins(AbstractDampedLaw):
    r"""Law with the damping factor chi = 3 (1 - c)(11 - c)/(2 (1 + 9 c)).

    Source: A. S. Carvalho, J. M. Martins 2019.

    $$\chi = \frac{3 (1 - c) (11 - c)}{2 (1 + 9 c)}$$

    It delivers the requested restitution to four digits for c >= 0.5.

    >>> law = cj.laws.CarvalhoMartins(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.3732, delivers 0.8000
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 3 (1 - c)(11 - c)/(2 (1 + 9 c))."""
        c = self.restitution
        return 1.5 * (1.0 - c) * (11.0 - c) / (1.0 + 9.0 * c)


class AbstractReboundingLaw(AbstractDampedLaw):
    """Base class of laws whose damping factor is infinite for a restitution of zero.

    **Raises:** `ValueError` for this restitution.
    """

    def __check_init__(self):
        require_rebound(self.restitution)


class Flores2011(AbstractReboundingLaw):
    r"""Law with the damping factor chi = 8 (1 - c)/(5 c), for restitutions from nearly 0 to 1.

    Source: P. Flores et al. 2011.

    $$\chi = \frac{8 (1 - c)}{5 c}$$

    K. Ye et al. 2009 derived the same factor for the exponent 1.5.

    >>> law = cj.laws.Flores2011(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.4000, delivers 0.7885
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 8 (1 - c)/(5 c)."""
        return 1.6 * (1.0 - self.restitution) / self.restitution


class Gonthier(AbstractReboundingLaw):
    r"""Law with the damping factor chi = (1 - c^2)/c.

    Source: Y. Gonthier et al. 2004, as an approximation of the equation that `ExactRestitution`
    solves.

    $$\chi = \frac{1 - c^2}{c}$$

    >>> law = cj.laws.Gonthier(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.4500, delivers 0.7680
    """

    def damping_factor(self) -> Scalar:
        """Return chi = (1 - c^2)/c."""
        return (1.0 - self.restitution**2) / self.restitution


class GharibHurmuzlu(AbstractReboundingLaw):
    r"""Law with the damping factor chi = 1/c, for nearly plastic impacts.

    Source: M. Gharib, Y. Hurmuzlu 2012.

    $$\chi = \frac{1}{c}$$

    The delivered restitution never exceeds 0.594, its value for c = 1.

    >>> law = cj.laws.GharibHurmuzlu(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    1.2500, delivers 0.5362
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 1/c."""
        return 1.0 / self.restitution


class HuGuo(AbstractReboundingLaw):
    r"""Law with the damping factor chi = 3 (1 - c)/(2 c).

    Source: S. Hu, X. Guo 2015.

    $$\chi = \frac{3 (1 - c)}{2 c}$$

    >>> law = cj.laws.HuGuo(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.3750, delivers 0.7992
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 3 (1 - c)/(2 c)."""
        return 1.5 * (1.0 - self.restitution) / self.restitution


class SafaeifarFarshidianfar(AbstractReboundingLaw):
    r"""Law with the damping factor chi = 5 (1 - c)/(4 c).

    Source: H. Safaeifar, A. Farshidianfar 2020.

    $$\chi = \frac{5 (1 - c)}{4 c}$$

    >>> law = cj.laws.SafaeifarFarshidianfar(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.3125, delivers 0.8271
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 5 (1 - c)/(4 c)."""
        return 1.25 * (1.0 - self.restitution) / self.restitution


class YePounding(AbstractReboundingLaw):
    r"""Law with the damping factor chi = 3 (1 - c)/(2 c) and a linear spring.

    Source: K. Ye et al. 2009, for colliding buildings.

    $$\chi = \frac{3 (1 - c)}{2 c}$$

    >>> law = cj.laws.YePounding(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.3750, delivers 0.7992
    """

    exponent: float = eqx.field(default=1.0, static=True)

    def damping_factor(self) -> Scalar:
        """Return chi = 3 (1 - c)/(2 c)."""
        return 1.5 * (1.0 - self.restitution) / self.restitution


class PantWijeyewickrema(AbstractReboundingLaw):
    r"""Law with the damping factor chi = 3 (1 - c^2)/(2 c^2) and a linear spring.

    Source: D. R. Pant, A. C. Wijeyewickrema 2012.

    $$\chi = \frac{3 (1 - c^2)}{2 c^2}$$

    The delivered restitution is far too small: 0.22 for c = 0.5, and 0.81 for c = 0.9. Use this law
    only to reproduce published results.

    **Warns:** `LawRangeWarning` for any restitution below 1.

    >>> import warnings
    >>> warnings.filterwarnings("ignore", category=cj.LawRangeWarning)
    >>> law = cj.laws.PantWijeyewickrema(restitution=0.9, stiffness=1e6)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.3519, delivers 0.8093
    """

    exponent: float = eqx.field(default=1.0, static=True)

    def _caution_together(self) -> None:
        requested = concrete(self.restitution)
        if requested is not None and requested < 1.0:
            caution(
                f"`PantWijeyewickrema` delivers far less than the requested restitution of "
                f"{float(requested):g}, for example 0.22 for 0.5: use `ExactRestitution`.",
                LawRangeWarning,
            )

    def damping_factor(self) -> Scalar:
        """Return chi = 3 (1 - c^2)/(2 c^2)."""
        return 1.5 * (1.0 - self.restitution**2) / self.restitution**2


class ExactRestitution(AbstractReboundingLaw):
    r"""Law whose damping factor chi delivers exactly the requested restitution c in a free impact.

    $$\chi (1 + c) = \ln \frac{1 + \chi}{1 - \chi c}$$

    The equation holds for any elastic force and is solved numerically for chi.

    Source: Y. Gonthier et al. 2004; J. Zhang, I. Sharf 2009.

    >>> law = cj.laws.ExactRestitution(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.3731, delivers 0.8000
    """

    def damping_factor(self) -> Scalar:
        """Return the solution chi of chi (1 + c) = ln[(1 + chi)/(1 - chi c)]."""
        return exact_damping_factor(self.restitution)
