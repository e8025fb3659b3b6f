"""Where searches begin."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..fields.checks import require, require_count
from ..model.bodies import State
from ..model.scene import Scene
from ..parametrisation.parameter import Parameter

Guess = Mapping[str, float]


@dataclass(frozen=True)
class Starts:
    """A number of starts: the first guess, and others drawn around it.

    **Arguments:**

    - `number`: of all starts.
    - `spread`: half the width of the interval from which coordinates are drawn evenly, in the
      coordinates of the scales (of a `Log` scale: 1 is a factor of e both ways): one number, or
      one by parameter.
    - `seed`: of the generator.
    """

    number: int
    spread: float | Mapping[str, float] = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        require_count("number", self.number, "ask for one start at least")

    def around(self, first: np.ndarray, names: Sequence[str]) -> np.ndarray:
        """Coordinates (number, p) of the starts around those of the first (p,)."""
        drawn = np.random.default_rng(self.seed).uniform(-1.0, 1.0, (self.number, len(first)))
        drawn[0] = 0.0
        return first + half_widths(self.spread, names) * drawn


def half_widths(spread: float | Mapping[str, float], names: Sequence[str]) -> np.ndarray:
    """A spread (p,), one number or one by parameter, zero for those left out.

    **Raises:** `ValueError` for an unknown parameter.
    """
    if not isinstance(spread, Mapping):
        return np.full(len(names), float(spread))
    _require_known("spread", spread, names)
    return np.array([float(spread.get(name, 0.0)) for name in names])


def start_coordinates(
    scene: Scene,
    state: State,
    parameters: Mapping[str, Parameter],
    guess: Guess | Sequence[Guess] | None,
    starts: Starts | None,
) -> np.ndarray:
    """Coordinates (S, p) of all starts: the guesses, then what is drawn around the first.

    **Raises:** `ValueError` for a guess of an unknown parameter, or outside its scale.
    """
    names = tuple(parameters)
    several = isinstance(guess, Sequence)
    guesses: list[Guess] = list(guess) if several else [{} if guess is None else guess]
    require(len(guesses) > 0, "guess", guesses, "at least one start", "leave it out")
    rows = []
    for one in guesses:
        kind, remedy = type(one).__name__, "pass {parameter: value}, or a list of these"
        require(isinstance(one, Mapping), "guess", kind, "values by name", remedy)
        _require_known("guess", one, names)
        rows.append([_coordinate(scene, state, p, one, name) for name, p in parameters.items()])
    given = np.array(rows)
    if starts is None:
        return given
    return np.concatenate([given, starts.around(given[0], names)[1:]])


def _coordinate(scene: Scene, state: State, parameter: Parameter, guess: Guess, name: str) -> float:
    try:
        if name in guess:
            return parameter.scale.coordinate(guess[name])
        return parameter.coordinate_in(scene, state)
    except ValueError as error:
        raise ValueError(f"Parameter {name!r}: {error}") from error


def _require_known(argument: str, given: Mapping[str, float], names: Sequence[str]) -> None:
    unknown = sorted(set(given) - set(names))
    remedy = f"name parameters: {', '.join(names)}"
    require(not unknown, argument, unknown, "of parameters that are estimated", remedy)
