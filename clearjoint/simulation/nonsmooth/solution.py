"""What a run with rigid contacts returns."""

import equinox as eqx

from ...dynamics.formulation import Formulation
from ...fields.readable import AbstractReadable
from ...model.bodies import State
from ...results import RESULTS
from ..aliases import Integers, Numbers
from ..solution import Trajectory


class ContactTotals(AbstractReadable):
    """What a rigid contact did since the start.

    - `impacts`: steps with an impulse that follow one without. A contact that rolls may hop, which
      counts each time.
    - `impulse`: sum of the normal impulses, N s. There is no peak force: an impact takes no time.
    - `dissipated`: J, by restitution and friction.
    - `hardest`: largest impulse of a step, N s. `fastest`: largest approach speed with one, m/s.
    - `penetration`: deepest in the middle of a step, m.

    >>> scene, state = cj.double_pendulum()
    >>> totals = cj.simulate_nonsmooth(scene, state, 0.02, step=1e-4).contacts["shoulder"]["V"]
    >>> bool(totals.impulse > 0.0)
    True
    """

    impacts: Integers
    impulse: Numbers
    dissipated: Numbers
    hardest: Numbers
    fastest: Numbers
    penetration: Numbers


class NonsmoothSolution(AbstractReadable):
    """The outcome of `clearjoint.simulate_nonsmooth`.

    - `time`, `final`, `result`: as of `Solution`.
    - `steps`: how many were taken.
    - `saved`: the states at the requested times, and `history[joint][contact]` the `ContactTotals`
      up to each of them, both ``None`` if none were requested. `saved_count` of them were reached;
      the others repeat the last state.
    - `contacts[joint][contact]`: the `ContactTotals` of the run.
    - `residual`: largest violation of the contacts' laws in any step, over its largest velocity.
    - `formulation`, `redundant_constraints`: as of `Solution`. `observe` takes
      such a solution too, for all but forces.

    >>> scene, state = cj.double_pendulum()
    >>> solution = cj.simulate_nonsmooth(scene, state, 0.02, step=1e-4)
    >>> int(solution.steps)
    200
    """

    time: Numbers
    final: State
    result: RESULTS
    steps: Integers
    saved: Trajectory | None
    history: dict[str, dict[str, ContactTotals]] | None
    saved_count: Integers | None
    contacts: dict[str, dict[str, ContactTotals]]
    residual: Numbers
    formulation: Formulation
    redundant_constraints: tuple[str, ...] = eqx.field(static=True)
