"""Servo: a sampled position controller with the limits of its motor, and its encoder."""

from typing import Literal

import equinox as eqx
import jax.numpy as jnp
from typing_extensions import override

from ..._fields.checks import require, require_count, require_numbers
from ..._fields.objects import optional_quantity, quantity
from ..._fields.types import Quadruple, Single
from ..._math.smoothing import TURN, wrapped
from ..._math.vectors import Scalar
from ..bodies import Wrench
from ..contact.laws import require_instance
from ..joints.base import PARALLEL, Motions
from ..joints.constraint_rows import row_rate
from ..joints.sampled_force import AbstractSampledForce, ForceMemory, Periodic
from .drivers import ROUNDING, SI, AbstractDriveAboutAxis, limited, torque_about
from .functions_of_time import FunctionOfTime, as_function_of_time, value_and_rate

SpeedSource = Literal["difference", "sensor"]


class Encoder(AbstractDriveAboutAxis):
    """Sensor of the angle of a second body relative to a first, for `Servo`.

    **Arguments:** `axis`: (3,) in the first body's axes, any length. `orientation`: (4,) Euler
    parameters of the second body in the first at angle zero, as in `PrescribedRotation`.

    >>> on_link = cj.Encoder("upper arm", "forearm", axis=(0, 0, 1))
    """

    orientation: Quadruple = quantity("1", default=PARALLEL)


class Servo(AbstractDriveAboutAxis, AbstractSampledForce):
    """A sampled PD or PID position controller with the limits of its motor.

    At multiples of its period, 1/`rate`, the servo reads its encoder and the target and commands a
    torque, P (goal - angle) + D (goal's rate - speed) + integral, which acts after the loop's delay
    until the next command replaces it. Choose it for a robot's joint whose measured goal and
    position are to be predicted or fitted: `Motor` has neither sampling nor delay, and damps more
    than a servo with the same gains.

    - **Start.** A run that starts without `State.memory` of the servo begins with a sample, whose
      torque acts at once, as if it had been commanded for longer than the delay.
    - **Speed.** "difference" takes the change of the angle since the last sample over the period,
      as a servo with an encoder does; it lags by half a period. "sensor" reads the speed. If the
      delay is then a whole number of periods, the speed has a kink at the samples, and derivatives
      by delay and rate are those towards a longer delay.
    - **Goal.** The goal is the target, and its rate the target's derivative by time, zero for a
      `PiecewiseConstant`. Steps need not end at the times of a table. If the times of a table are
      rounded, a small `offset` makes each sample read the row of its own time. With a
      `speed_limit`, the goal starts at the present angle and follows the target up to this speed.
    - **Torque limits.** The commanded torque is limited to `torque_limit`, or else to the
      `stall_torque`, if there is one. The voltage of a motor with a `stall_torque` T and a
      `no_load_speed` v can drive torques from -T (1 + w/v) to T (1 - w/v) against the back EMF at
      the speed w. This limit acts on the torque between samples too, rounded as in `Motor`.
    - **Integral.** It stops growing while the torque is at a limit (conditional integration).
    - **Angle.** The servo counts revolutions, from an angle within half a revolution of the target.
    - **Resolution.** Angles are not rounded to counts of the encoder: derivatives would vanish. In
      a fit, count the resolution r, rad, as noise of the measured angle, r/sqrt(12).

    The memory, ``state.memory[servo]``, has "torque", the commanded torque in effect, N m; "angle",
    the last reading, rad; with an integral, "integral", N m; with a speed limit, "goal", rad; with
    a delay, "command 0" (the newest), "command 1", ..., N m.

    **Arguments:**

    - `target`: desired angle in rad, a number or a function of time, as for `Motor`.
    - `rate`: samples per second, Hz.
    - `proportional`, `derivative`, `integral`: gains, N m/rad, N m s/rad and N m/(rad s), not
      negative; no integral by default.
    - `delay`: from reading to torque, s; none by default. It may be at most `delay_periods`
      periods, a whole number, by default 1.
    - `torque_limit`, N m; `speed_limit`, rad/s; `stall_torque`, N m, with `no_load_speed`, rad/s:
      positive; no limits by default.
    - `torque_constant`: torque per current, N m/A, for `quantities.MotorCurrent`.
    - `encoder`: an `Encoder` elsewhere than between the bodies of the torque, such as on the link
      behind a gear with play; by default it is between them.
    - `speed_from`: "difference" or "sensor".
    - `offset`: time of a sample, s; zero by default.
    - `axis`: of the torque, which acts on the second body, right-handed about the axis; (3,) in the
      first body's axes, any length. `orientation`: (4,) Euler parameters of the second body in the
      first at angle zero, as in `PrescribedRotation`.

    **Raises:** `ValueError` also for a delay of more than `delay_periods` periods, and if only one
    of stall torque and no-load speed is given.

    >>> servo = cj.Servo(
    ...     *("ground", "arm", (0, 0, 1)), target=0.5, rate=200.0, proportional=20.0,
    ...     derivative=0.4, delay=0.005, stall_torque=3.0, no_load_speed=5.0
    ... )
    >>> list(servo.instants())
    ['sample', 'command']
    """

    target: FunctionOfTime = quantity("rad", converter=as_function_of_time)
    rate: Single = quantity("Hz", shape=(), positive=True)
    proportional: Single = quantity("N m/rad", shape=(), positive=True, zero=True, remedy=SI)
    derivative: Single = quantity(
        "N m s/rad", shape=(), default=0.0, positive=True, zero=True, remedy=SI
    )
    integral: Single | None = optional_quantity("N m/(rad s)", positive=True, zero=True, remedy=SI)
    delay: Single | None = optional_quantity("s", positive=True, zero=True)
    torque_limit: Single | None = optional_quantity("N m", positive=True, remedy=SI)
    speed_limit: Single | None = optional_quantity("rad/s", positive=True, remedy=SI)
    stall_torque: Single | None = optional_quantity("N m", positive=True, remedy=SI)
    no_load_speed: Single | None = optional_quantity("rad/s", positive=True, remedy=SI)
    torque_constant: Single | None = optional_quantity("N m/A", positive=True, remedy=SI)
    encoder: Encoder | None = None
    speed_from: SpeedSource = eqx.field(default="difference", static=True)
    delay_periods: int = eqx.field(default=1, static=True)
    offset: Single = quantity("s", shape=(), default=0.0)
    orientation: Quadruple = quantity("1", default=PARALLEL)

    @override
    def _check_together(self) -> None:
        sources = ("difference", "sensor")
        remedy = "pass one of these"
        if self.encoder is not None:
            require_instance("encoder", self.encoder, Encoder, remedy="pass Encoder(...) or None")
        require(self.speed_from in sources, "speed_from", self.speed_from, f"in {sources}", remedy)
        require_count("delay_periods", self.delay_periods, "round the delay up")
        agree = (self.stall_torque is None) == (self.no_load_speed is None)
        given = "no_load_speed" if self.stall_torque is None else "stall_torque"
        lacking = "stall_torque" if self.stall_torque is None else "no_load_speed"
        require(agree, lacking, None, f"given together with `{given}`", "pass both or neither")
        if self.delay is not None:
            periods = self.delay_periods
            require_numbers(
                lambda delay, rate: delay * rate <= periods + 1e-9,
                "delay",
                (self.delay, self.rate),
                f"at most `delay_periods`/`rate`, which is {periods}/({{1}} Hz)",  # {1}: rate
                "pass a larger `delay_periods`, for which the servo keeps as many commands",
            )

    @override
    def body_names(self) -> tuple[str, ...]:
        others = () if self.encoder is None else self.encoder.pair()
        return tuple(dict.fromkeys((*self.pair(), *others)))

    @override
    def instants(self) -> dict[str, Periodic]:
        period = 1.0 / self.rate
        samples = {"sample": Periodic(period, self.offset)}
        if self.delay is None:
            return samples
        return {**samples, "command": Periodic(period, self.offset + self.delay)}

    @override
    def initial_memory(self, motions: Motions, t: Scalar) -> dict[str, Scalar]:
        angle, speed = self._reading(motions)
        target, _ = value_and_rate(self.target, t)
        # Within half a revolution of the target, since the revolutions before are unknown.
        angle = target - wrapped(target - angle, TURN)
        last_sample = self.instants()["sample"].latest(t)
        # The last sample was before the start: its angle is extrapolated by the present speed.
        memory = {"angle": angle - speed * (t - last_sample)}
        if self.integral is not None:
            # Zero, but of the angle's type: the integral has this type after a sample too.
            memory["integral"] = 0.0 * angle
        if self.speed_limit is not None:
            memory["goal"] = angle
        torque, changed = self._commanded(memory, angle, speed, motions, t)
        # The torque acts at once, as if all commands before had been equal to it.
        commands = [] if self.delay is None else self._commands()
        return {**memory, **changed, **dict.fromkeys(["torque", *commands], torque)}

    def _commands(self) -> list[str]:
        return [f"command {k}" for k in range(self.delay_periods + 1)]

    @override
    def updated_memory(
        self, name: str, memory: ForceMemory, motions: Motions, t: Scalar
    ) -> dict[str, Scalar]:
        # Names of the stored commands, from the newest to the oldest.
        commands = self._commands()
        # The delay of a command is over: its torque takes effect.
        if name == "command":
            # By so many samples the command is older than the newest one. A delay that is shorter
            # than a whole number of periods by a rounding error counts as this number.
            assert self.delay is not None
            age = jnp.floor(self.delay * self.rate + 1e-12)
            # The torque of `commands[age]`; `age` may be traced, so that it can't index a list.
            torque = memory[commands[0]]
            for k, command in enumerate(commands[1:]):
                torque = jnp.where(age > k, memory[command], torque)
            return {**memory, "torque": torque}
        # The other instants are samples.
        angle, speed = self._reading(motions)
        # Revolutions are counted from the angle that the speed predicts.
        predicted = memory["angle"] + speed / self.rate
        angle = predicted + wrapped(angle - predicted, TURN)
        if self.speed_from == "difference":
            speed = (angle - memory["angle"]) * self.rate
        torque, changed = self._commanded(memory, angle, speed, motions, t)
        memory = {**memory, **changed, "angle": angle}
        # Without a delay the torque takes effect at once; otherwise the oldest command is dropped.
        if self.delay is None:
            return {**memory, "torque": torque}
        newer = [torque, *(memory[command] for command in commands[:-1])]
        return {**memory, **dict(zip(commands, newer, strict=True))}

    def _reading(self, motions: Motions) -> tuple[Scalar, Scalar]:
        """Return the encoder's angle, rad in [-pi, pi], and its rate, rad/s."""
        angle = (self if self.encoder is None else self.encoder).relative_angle(motions)
        return angle.value, row_rate(angle, motions)

    def _commanded(
        self, memory: ForceMemory, angle: Scalar, speed: Scalar, motions: Motions, t: Scalar
    ) -> tuple[Scalar, dict[str, Scalar]]:
        """Return the torque, N m, that the servo commands at a sample, and the changed entries of
        its memory. `angle`, rad, and `speed`, rad/s, are those of the encoder; `motions` give the
        motor's speed, for the torque limits at which the integral stops growing."""
        changed: dict[str, Scalar] = {}
        goal, goal_speed = value_and_rate(self.target, t)
        # In a period, the goal follows the target by at most the speed limit times the period.
        if self.speed_limit is not None:
            farthest = self.speed_limit / self.rate
            moved = jnp.clip(goal - memory["goal"], -farthest, farthest)
            goal, goal_speed = memory["goal"] + moved, moved * self.rate
            changed["goal"] = goal
        error = goal - angle
        torque = self.proportional * error + self.derivative * (goal_speed - speed)
        # ``None`` if there is neither a torque limit nor a stall torque.
        largest = self.stall_torque if self.torque_limit is None else self.torque_limit
        if self.integral is not None:
            integral = memory["integral"] + self.integral * error / self.rate
            if largest is not None:
                # Against windup, the integral keeps its value while the torque is beyond a limit
                # and the error would move it further. The limits are `largest` and what the motor
                # can drive at its present speed, which `present_torque` enforces at all times.
                lowest, highest = self._drivable(motions) or (-largest, largest)
                beyond = torque + integral > jnp.minimum(highest, largest)
                below = torque + integral < jnp.maximum(lowest, -largest)
                stays = beyond & (error > 0.0) | below & (error < 0.0)
                integral = jnp.where(stays, memory["integral"], integral)
            changed["integral"], torque = integral, torque + integral
        return (torque if largest is None else jnp.clip(torque, -largest, largest)), changed

    def _drivable(self, motions: Motions) -> tuple[Scalar, Scalar] | None:
        """Return the least and the largest torque, N m, that the motor's voltage can drive at its
        present speed; ``None`` for no such limits."""
        if self.stall_torque is None or self.no_load_speed is None:
            return None
        lost = self.stall_torque * self.speed(motions) / self.no_load_speed
        return -self.stall_torque - lost, self.stall_torque - lost

    def present_torque(self, memory: ForceMemory, motions: Motions) -> Scalar:
        """Return the motor's torque on the second body, N m."""
        torque, drivable = memory["torque"], self._drivable(motions)
        if drivable is None or self.stall_torque is None:
            return torque
        return limited(torque, *drivable, ROUNDING * self.stall_torque)

    @override
    def held_wrenches(self, memory: ForceMemory, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        return torque_about(self.relative_angle(motions), self.present_torque(memory, motions))
