"""Orientations from an axis and an angle."""

import math

import jax
import jax.numpy as jnp
import numpy as np

from ..fields.checks import as_number, caution_above, require_axis, require_shape
from ..fields.types import Quadruple, TripleLike
from ..math.vectors import Scalar

MOST_REVOLUTIONS = 2
"""Number of revolutions above which a warning asks whether the angle is in degrees."""


def rotation(axis: TripleLike, angle: Scalar) -> Quadruple:
    """Return the Euler parameters of a rotation about an axis.

    They suit the arguments `orientation` of bodies, joints and drives.

    ```python
    import clearjoint as cj
    import numpy as np

    tilted = cj.rotation(axis=(0, 0, 1), angle=np.radians(30.0))
    state = cj.State({"arm": cj.body_state((0.5, 0.0, 0.0), orientation=tilted)})
    drive = cj.PrescribedRotation("ground", "arm", (0, 0, 1), speed=5.0, orientation=tilted)
    ```

    Scene files use a table instead: ``orientation = {axis = [0, 0, 1], angle = "30 deg"}``.

    **Arguments:**

    - `axis`: (3,), any length. A rotation does not change the components of its axis, so they may
      be given in the frame before or after the rotation.
    - `angle`: rad, right-handed.

    **Returns:** (4,) Euler parameters, scalar first. They transform components in the rotated frame
    to the original frame.

    **Raises:** `ValueError` if the axis has zero length, a number is not finite, or a shape is
    wrong.
    **Warns:** `UnusualValueWarning` if the angle exceeds two revolutions.
    """
    vector, radians = as_number(axis), as_number(angle)
    require_axis("axis", vector)
    require_shape("angle", radians, (), "pass one number in rad")
    caution_above("angle", abs(radians), "rad", MOST_REVOLUTIONS * 2.0 * math.pi, "give it in rad")
    # Known numbers stay in NumPy, so that nothing is compiled when a scene is built.
    numpy = jnp if isinstance(vector, jax.Array) or isinstance(radians, jax.Array) else np
    direction = vector / numpy.sqrt(vector @ vector)
    sine, cosine = numpy.sin(0.5 * radians), numpy.cos(0.5 * radians)
    return numpy.stack([cosine, *(sine * direction[k] for k in range(3))])
