"""Starts of a fit's searches: the user's guesses, and random starts around the first guess."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .._fields.checks import (
    as_number,
    errors_about,
    recheck,
    require,
    require_count,
    require_positive,
    require_type,
)
from .._model.bodies import State
from .._model.scene import Scene
from .._parametrisation.parameter import Parameter
from .._parametrisation.variations import with_values
from .points import Point

Guess = Mapping[str, float]
"""Values of some parameters by name, SI."""


@dataclass(frozen=True)
class Starts:
    """Guess and random starts around it, for a fit that searches from several starts.

    The random starts are uniformly distributed in a box around the guess, in the coordinates of the
    parameters, which are the values on their scales.

    **Arguments:**

    - `number`: number of starts, including the guess; `seed`: of the random starts.
    - `spread`: half the width of the box in each coordinate (on a `Log` scale, 1 is a factor of e
      in both directions): one number, or a dictionary by name of the parameter, in which missing
      parameters have width 0.

    **Raises:** `ValueError` for a `number` that is not a positive integer, and for a `spread` that
    is negative or not finite.

    >>> cj.Starts(4, spread=0.5)
    Starts(number=4, spread=0.5, seed=0)
    """

    number: int
    spread: float | Mapping[str, float] = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        require_count("number", self.number, "ask for one start at least")
        require_count("seed", self.seed, "pass 0", zero=True)
        spreads = self.spread if isinstance(self.spread, Mapping) else {"": self.spread}
        for name, spread in spreads.items():
            argument = f"spread[{name!r}]" if name else "spread"
            require_positive(argument, spread, "give a distance in coordinates", zero=True)

    def around(self, first: Point, names: Sequence[str]) -> Float[np.ndarray, "{self.number} p"]:
        """Return the coordinates of all starts: in the first row `first`, those of the guess, and
        then the random ones. `names`: the parameters in the order of coordinates."""
        offsets = np.random.default_rng(self.seed).uniform(-1.0, 1.0, (self.number, len(first)))
        offsets[0] = 0.0
        return first + half_widths(self.spread, names) * offsets


def half_widths(spread: float | Mapping[str, float], names: Sequence[str]) -> Point:
    """Return half the width, in each coordinate, of the box around a guess. `spread` is this number
    or has it by name of the parameter, with 0 for parameters that it lacks. `names`: all
    parameters, in the order of the coordinates."""
    if not isinstance(spread, Mapping):
        return np.full(len(names), as_number(spread, "spread"))
    _require_known("spread", spread, names)
    return np.array([float(spread.get(name, 0.0)) for name in names])


def start_coordinates(
    scene: Scene,
    state: State,
    parameters: Mapping[str, Parameter],
    guess: Guess | Sequence[Guess] | None,
    starts: Starts | None,
) -> Float[np.ndarray, "S p"]:
    """Return the coordinates of all S starts: of the guesses in their order, then random ones."""
    names = tuple(parameters)
    # `guess` is one guess or a list of guesses; without one, all parameters have their own values.
    several = isinstance(guess, Sequence)
    guesses: list[Guess] = list(guess) if several else [{} if guess is None else guess]
    require(len(guesses) > 0, "guess", guesses, "at least one start", "leave it out")
    rows = []
    for values in guesses:
        remedy = "pass {parameter: value}, or a list of these"
        require_type("guess", values, Mapping, "values by name", remedy)
        _require_known("guess", values, names)
        rows.append([_coordinate(scene, state, p, values, name) for name, p in parameters.items()])
    guessed = np.array(rows)
    if starts is None:
        return guessed
    # Random starts are around the first guess, which is also the first row of `around`.
    return np.concatenate([guessed, starts.around(guessed[0], names)[1:]])


def _coordinate(scene: Scene, state: State, parameter: Parameter, guess: Guess, name: str) -> float:
    with errors_about(f"Parameter {name!r}"):
        if name not in guess:  # The default is the parameter's `value` or the number in the scene.
            return parameter.coordinate_in(scene, state)
        value = np.asarray(as_number(guess[name], f"guess[{name!r}]"))
        coordinate = parameter.scale.coordinate(value)
        changed, _ = with_values(scene, state, [(parameter.variation, value.item())])
        recheck(changed)  # Raises the errors of constructors here, not in a run.
        return coordinate


def _require_known(argument: str, by_name: Mapping[str, float], names: Sequence[str]) -> None:
    unknown = sorted(set(by_name) - set(names))
    remedy = f"name parameters: {', '.join(names)}"
    require(not unknown, argument, unknown, "values of estimated parameters", remedy)
