"""Orientations by an axis and an angle."""

import math

import jax
import jax.numpy as jnp
import numpy as np

from ..fields.checks import as_number, caution_above, require_axis, require_shape
from ..fields.types import Quadruple, TripleLike
from ..math.vectors import Scalar

MOST_TURNS = 2
"""Turns beyond which an angle is mistaken for one in degrees."""


def rotation(axis: TripleLike, angle: Scalar) -> Quadruple:
    """Euler parameters of a turn about an axis: for `body_state` and wherever else an `orientation`
    is asked for.

    ```python
    import clearjoint as cj
    import numpy as np

    tilted = cj.rotation(axis=(0, 0, 1), angle=np.radians(30.0))
    state = cj.State({"arm": cj.body_state((0.5, 0.0, 0.0), orientation=tilted)})
    drive = cj.PrescribedRotation("ground", "arm", (0, 0, 1), speed=5.0, orientation=tilted)
    ```

    In a scene file a table stands in its place: ``orientation = {axis = [0, 0, 1], angle = "30
    deg"}``.

    **Arguments:** `axis`: (3,), of any length, the same in the axes of both frames; `angle`: rad,
    right-handed.

    **Returns:** (4,), the scalar part first.

    **Raises:** `ValueError` for an axis of length zero, and for what is not finite.
    """
    vector, turn = as_number(axis), as_number(angle)
    require_axis("axis", vector)
    require_shape("angle", turn, (), "pass one number in rad")
    caution_above("angle", abs(turn), "rad", MOST_TURNS * 2.0 * math.pi, "give it in rad")
    numpy = jnp if isinstance(vector, jax.Array) or isinstance(turn, jax.Array) else np
    direction = vector / numpy.sqrt(vector @ vector)
    sine, cosine = numpy.sin(0.5 * turn), numpy.cos(0.5 * turn)
    return numpy.stack([cosine, *(sine * direction[k] for k in range(3))])
