"""Uncertain numbers of a scene, with their distributions, and designs that draw them jointly."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .._dynamics.constraint_report import check_names
from .._fields.cautions import warn_the_user
from .._fields.checks import (
    as_number,
    require,
    require_count,
    require_positive,
    require_shape,
    require_types,
)
from .._model.bodies import State
from .._model.scene import Scene
from .._parametrisation.parameter import Parameter
from .._parametrisation.paths import NumberPath
from .._sweeps.axes import Axis

PASS_UNCERTAIN = (
    'pass {"clearance": cj.Uncertain(lambda s: s.joints["pin"].clearance, deviation=5e-6)}'
)
METHODS = ("sobol", "halton", "latin hypercube", "random")
"""Names of the designs that `design` accepts."""


@dataclass(frozen=True, init=False)
class Uncertain:
    """A number of the scene that differs between specimens, and its distribution.

    The distribution is that of the coordinate to which the scale of a `Parameter` maps the number's
    value. With the default scale, `Linear()`, the coordinate is the value itself; with `Log()` it
    is the natural logarithm of the value, so that a deviation of 0.02 is one of 2 %.

    **Arguments:**

    - `parameter`: a `Parameter`, or a path such as ``lambda scene: scene.joints["pin"].clearance``,
      with the scale `Linear()`. Its `value` is the nominal one, by default the number in the scene.
    - `deviation`: standard deviation of a normal distribution about the nominal value, in the
      coordinate.
    - `half_width`: half the width of a uniform distribution about the nominal value, in the
      coordinate.
    - `between`: the two bounds of a uniform distribution, as values in the parameter's unit. The
      nominal coordinate is then the middle of the bounds' coordinates.

    Exactly one of the last three must be given.

    **Raises:** `ValueError` for none or several of these three, a size that is not positive, and
    bounds that don't rise or are infinite.

    >>> path = lambda scene: scene.joints["shoulder"].clearance
    >>> cj.Uncertain(path, deviation=5e-6).deviation
    5e-06
    """

    parameter: Parameter
    deviation: float | None
    half_width: float | None
    between: tuple[float, float] | None

    def __init__(
        self,
        parameter: Parameter | NumberPath,
        *,
        deviation: float | None = None,
        half_width: float | None = None,
        between: tuple[float, float] | None = None,
    ):
        chosen = parameter if isinstance(parameter, Parameter) else Parameter(parameter)
        sizes = {"deviation": deviation, "half_width": half_width, "between": between}
        named = [name for name, size in sizes.items() if size is not None]
        expected = "one of deviation, half_width and between"
        require(len(named) == 1, "deviation", named, expected, "give exactly one of them")
        for name in ("deviation", "half_width"):
            if sizes[name] is not None:
                require_positive(name, sizes[name], "give the size of the variation")
        if between is not None:
            bounds = np.asarray(as_number(between, "between"))
            rising = bounds.shape == (2,) and bool(-np.inf < bounds[0] < bounds[1] < np.inf)
            require(rising, "between", between, "two rising, finite bounds", "pass (low, high)")
            sizes["between"] = float(bounds[0]), float(bounds[1])
        # The class is frozen, so its fields are set in the dictionary of the object.
        vars(self).update(parameter=chosen, **sizes)

    @property
    def is_normal(self) -> bool:
        """Whether the distribution is normal; otherwise it is uniform."""
        return self.deviation is not None

    def centre_and_size(self, scene: Scene, state: State) -> tuple[float, float]:
        """Return the middle, and the standard deviation or half width, in the coordinate."""
        if self.between is None:
            size = self.deviation if self.half_width is None else self.half_width
            assert size is not None
            return self.parameter.coordinate_in(scene, state), float(size)
        low, high = (self.parameter.scale.coordinate(bound) for bound in self.between)
        return 0.5 * (low + high), 0.5 * (high - low)

    def standardised(self, probabilities: np.ndarray) -> np.ndarray:
        """Return (coordinate - centre)/size of `centre_and_size` at cumulative `probabilities`."""
        from scipy.special import ndtri

        return ndtri(probabilities) if self.is_normal else 2.0 * probabilities - 1.0

    def axis(self, scene: Scene, state: State, standardised: Float[np.ndarray, " n"]) -> Axis:
        """Return a sweep's axis for n numbers (coordinate - centre)/size, see `centre_and_size`."""
        centre, size = self.centre_and_size(scene, state)
        scale = self.parameter.scale
        # One at a time: a user-defined scale need not accept arrays.
        values = [float(scale.value(u)) for u in (centre + size * standardised).tolist()]
        return Axis(self.parameter.variation, np.array(values))


def check_uncertain(uncertain: Mapping[str, Uncertain]) -> None:
    require_types("uncertain", uncertain, Uncertain, "an Uncertain", PASS_UNCERTAIN)
    require(len(uncertain) > 0, "uncertain", {}, "not empty", PASS_UNCERTAIN)


def check_confidence(confidence: float) -> None:
    require_shape("confidence", confidence, (), remedy := "pass for example 0.95")
    require(0.0 < float(confidence) < 1.0, "confidence", confidence, "between 0 and 1", remedy)


def unit_cube(dimensions: int, draws: int, method: str, seed: int) -> Float[np.ndarray, "n d"]:
    """Return the n = `draws` points of a `design` in the unit cube; raise and warn as `design`."""
    from scipy.stats import qmc

    require(method in METHODS, "method", method, f"one of {METHODS}", "choose one of them")
    require_count("draws", draws, "give a number of points")
    require_count("seed", seed, "give a whole number", zero=True)
    rng = np.random.default_rng(seed)
    if method == "random":
        return rng.random((draws, dimensions))
    if method == "sobol":
        # A full power of two is drawn and cut to `draws`, so that SciPy does not issue its own
        # warning, which has no advice.
        exponent = (int(draws) - 1).bit_length()
        if draws != 2**exponent:
            warn_the_user(
                f"Argument `draws` is {draws}, but Sobol points fill the distributions evenly only "
                f"if it is a power of two: pass {2 ** (exponent - 1)} or {2**exponent}, or "
                'method="halton".'
            )
        return qmc.Sobol(dimensions, rng=rng).random_base2(exponent)[:draws]
    sampler = qmc.Halton if method == "halton" else qmc.LatinHypercube
    return sampler(dimensions, rng=rng).random(draws)


def design(
    scene: Scene,
    state: State,
    uncertain: Mapping[str, Uncertain],
    draws: int,
    method: str = "sobol",
    seed: int = 0,
) -> dict[str, Axis]:
    """Draw several numbers of a scene jointly from their distributions, as axes of a zipped sweep.

    Pass the result to ``sweep(..., axes, zipped=True)``. Except for "random", the points are those
    of `scipy.stats.qmc`, randomised by the seed. Except for "latin hypercube", points of a larger
    `draws` begin with those of a smaller one, so that a stored sweep can be extended.

    **Arguments:**

    - `scene`, `state`: with the nominal values.
    - `uncertain`: the numbers to draw, `Uncertain` by name.
    - `draws`: number of points; for "sobol" preferably a power of two, for which the points fill
      the distributions evenly.
    - `method`: "sobol", "halton", "latin hypercube", or "random" for independent draws.

    **Raises:** `ValueError` for unsupported arguments, and for a nominal value or bound that the
    parameter's scale does not allow.

    **Warns:** `UserWarning` for "sobol" and a number of `draws` that is not a power of two.

    >>> tolerance = cj.Uncertain(lambda s: s.forces["spring"].stiffness, half_width=5.0)
    >>> axes = cj.design(scene, state, {"stiffness": tolerance}, 4, "latin hypercube")
    >>> bool((abs(axes["stiffness"].values - 100.0) <= 5.0).all())
    True
    """
    check_names(scene, state)
    check_uncertain(uncertain)
    points = unit_cube(len(uncertain), draws, method, seed)
    return axes_at(scene, state, uncertain, points)


def axes_at(
    scene: Scene, state: State, uncertain: Mapping[str, Uncertain], points: np.ndarray
) -> dict[str, Axis]:
    """Return an axis for each of p numbers, at their cumulative probabilities `points`, (n, p)."""
    pairs = zip(uncertain.items(), points.T, strict=True)
    return {name: u.axis(scene, state, u.standardised(column)) for (name, u), column in pairs}
