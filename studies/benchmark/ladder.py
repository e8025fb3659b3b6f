"""Cost by the size of the mechanism: first answers, repeated calls, steps and memory.

    python -m studies.benchmark.ladder [NAME ...] [--calls CALL ...] [--quick] [--limit S]
                                       [--output FOLDER] [--write]

Measures the named scenes of `ladder_scenes.SCENES`, or all, in `simulate`, `sweep` and
`sensitivities`. Each measurement runs in a fresh process, which ends after `--limit` seconds of
processor time; larger sizes of its scene are then left out. Chains and humanoids are compared with
MuJoCo and Pinocchio where these are installed. Times are processor times.
"""

import argparse
import itertools
import json
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import equinox as eqx
import numpy as np
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint.plot import style
from clearjoint.testing import optimise_programs
from studies.benchmark.ladder_scenes import SCENES
from studies.benchmark.ladder_yardsticks import yardsticks
from studies.benchmark.table import on_cores, replace_table, shown
from studies.common.fresh_process import lines_of_process
from studies.common.report import markdown, report

HERE = Path(__file__).resolve().parent
SIZES: dict[str, tuple[int, ...]] = {
    "backlash": (1, 3, 10, 30, 100),
    "ideal": (1, 3, 10, 30, 100),
    "humanoid": (23, 29),
    "four-bars": (1, 2, 4, 8, 16),
    "scissor": (1, 2, 4, 8),
}
QUICK_SIZES: dict[str, tuple[int, ...]] = {"ideal": (1, 2)}
SIMULATE, SWEEP, SENSITIVITIES = "simulate", "sweep", "sensitivities"
CALLS = (SIMULATE, SWEEP, *(f"{SENSITIVITIES} {count}" for count in (1, 3, 8)))
"""Calls that are measured; the number is that of the parameters."""
SHORT, LONG = 1e-4, 0.05
"""Simulated times, s: so short that only the preparation counts, and the shortest one for the time
of a step. It is doubled until a run takes `LONG_ENOUGH`."""
LONGEST, LONGEST_OTHERS = 204.8, 12.8
"""Longest simulated times, s, of `simulate` and of the other calls: derivatives grow with time, and
some runs with them fail after 30 s."""
LONG_ENOUGH = 0.2
"""Processor time of a run from which a step is timed, s: many steps of 4 ms, those of the clock of
some machines."""
LANES = 8
LIMIT = 120.0
"""Processor time, s, after which a measurement ends."""
CALLS_BEFORE, CALLS_COUNTED, ROUNDS = 20, 25, 9
"""Calls before repeated calls are timed, after which native code checks starts; calls that are
timed together; and how often, of which the median is taken."""
NUDGE = 1e-9
"""Relative change of a mass from call to call. A start with equal numbers is checked only once."""
FITTED = 3
"""Number of largest sizes from which an exponent is fitted."""
MEGABYTE = 1024.0
"""Kilobytes, the unit in which Linux reports memory."""
FRESH = """
import resource, sys
limit = int(float(sys.argv[2]))
resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))
import clearjoint as cj
cj.configure(cache=sys.argv[1])
from studies.benchmark.ladder import print_costs
print_costs(*sys.argv[3:])
"""


@dataclass(frozen=True)
class Cost:
    """Cost of a call for a scene of some size, in s of processor time; ``None`` if not measured.

    - `first`, `kept`: of the first call of a process over `SHORT`, with nothing kept on disk, and
      with the cache of an earlier process.
    - `again`: of a repeated call over `SHORT`.
    - `step`: of an attempted step; of all lanes together in a sweep.
    - `memory`: MB, the most that the process with nothing kept has used.
    - `stopped`: whether the limit ended a process.
    """

    scene: str
    size: int
    call: str
    first: float | None = None
    kept: float | None = None
    again: float | None = None
    step: float | None = None
    memory: float | None = None
    stopped: bool = False

    def cells(self) -> tuple[str, ...]:
        """Return the row of the table."""
        times = [
            "" if value is None else shown(value)
            for value in (self.first, self.kept, self.again, self.step)
        ]
        memory = "" if self.memory is None else f"{self.memory:.0f} MB"
        label = f"{self.scene}, {self.size}", self.call + (" (stopped)" if self.stopped else "")
        return *label, *times, memory


HEAD = ("scene", "call", "first, nothing kept", "first, kept", "repeated", "step", "memory")


def costs(sizes: dict[str, tuple[int, ...]], calls: Sequence[str], limit: float) -> list[Cost]:
    """Measure all calls for each size of each scene, each in fresh processes on one core."""
    found: list[Cost] = []
    with on_cores(1):
        for scene, numbers in sizes.items():
            for call in calls:
                for size in numbers:
                    found.append(cost(scene, size, call, limit))
                    print(" | ".join(found[-1].cells()), file=sys.stderr, flush=True)
                    if found[-1].stopped:
                        break
    return found


def cost(scene: str, size: int, call: str, limit: float) -> Cost:
    """Measure a call for a scene of some size in two processes, without and with a cache."""
    with tempfile.TemporaryDirectory() as cache:
        arguments = str(limit), scene, str(size), call
        lines, failed = lines_of_process(FRESH, cache, *arguments, "all")
        parts: dict[str, float] = {}
        for line in lines:
            parts |= json.loads(line)
        if not failed:
            lines, failed = lines_of_process(FRESH, cache, *arguments, "first")
            for line in lines:
                parts["kept"] = json.loads(line)["first"]
    return Cost(scene, size, call, **parts, stopped=failed)  # pyright: ignore[reportArgumentType]


def print_costs(scene: str, size: str, call: str, which: str) -> None:
    """Measure a call in this process, and print each part of its cost as soon as it is known.

    **Arguments:** `which`: "first" for the first call only, otherwise "all".
    """
    run = _runs(call, *SCENES[scene](int(size)))
    if run is None:  # The scene has too few parameters.
        return

    def say(**parts: float) -> None:
        print(json.dumps(parts), flush=True)

    first, _ = _timed(run, SHORT)
    say(first=first)
    if which == "first":
        return
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / MEGABYTE
    say(memory=memory)
    for _ in range(CALLS_BEFORE if call == SIMULATE else 1):
        run(SHORT)

    def several(span: float, run: Callable[[float], int] = run) -> int:
        return [run(span) for _ in range(CALLS_COUNTED)][0]

    rounds = [_timed(several, SHORT) for _ in range(ROUNDS if call == SIMULATE else 1)]
    together, few = sorted(rounds)[len(rounds) // 2]
    again = together / CALLS_COUNTED
    say(again=again)
    optimise_programs()
    span, longest = LONG, LONGEST if call == SIMULATE else LONGEST_OTHERS
    while (timed := _timed(run, span))[0] < LONG_ENOUGH and span < longest:
        span *= 2.0
    seconds, steps = timed
    if seconds >= LONG_ENOUGH and steps > few:  # Otherwise the clock's steps would hide it.
        say(step=(seconds - again) / (steps - few))


def _timed(run: Callable[[float], int], span: float) -> tuple[float, int]:
    """Return the processor time of a call, s, and its number of attempted steps."""
    begun = time.process_time()
    steps = run(span)
    return time.process_time() - begun, steps


def _runs(call: str, scene: cj.Scene, state: cj.State) -> Callable[[float], int] | None:
    """Return a function of the simulated time that makes the call and returns the number of its
    attempted steps; ``None`` if the scene has fewer parameters than the call needs."""
    last = list(scene.bodies)[-1]
    height = cj.quantities.Position(last, "y")
    if call == SIMULATE:
        mass = float(scene.bodies[last].mass)
        scenes = itertools.cycle(
            [
                eqx.tree_at(lambda s: s.bodies[last].mass, scene, mass * (1.0 + k * NUDGE))
                for k in range(CALLS_BEFORE + ROUNDS * CALLS_COUNTED + 1)
            ]
        )
        return lambda span: int(cj.simulate(next(scenes), state, span, progress=False).attempts)
    if call == SWEEP:
        mass = float(scene.bodies[last].mass)
        values = mass * np.linspace(0.9, 1.1, LANES)
        axes = {"mass": cj.Axis(lambda s: s.bodies[last].mass, values)}
        outputs = {"top": cj.Peak(height, "m")}
        return lambda span: int(
            cj.sweep(scene, state, span, axes, outputs, progress=False).attempts.max()
        )
    count = int(call.removeprefix(SENSITIVITIES))
    parameters = dict(list(_parameters(scene))[:count])
    if len(parameters) < count:
        return None
    return lambda span: int(
        cj.sensitivities(
            scene, state, span, parameters, {"y": height}, [span], progress=False
        ).attempts
    )


def _parameters(scene: cj.Scene) -> Iterable[tuple[str, cj.Parameter]]:
    """Yield masses and moments of inertia of bodies, the last body first."""
    for name in reversed(list(scene.bodies)):
        yield f"mass of {name}", cj.Parameter(lambda s, n=name: s.bodies[n].mass, cj.Log())
        for k in range(3):
            moment = cj.Parameter(lambda s, n=name, k=k: s.bodies[n].inertia[k], cj.Log())
            yield f"moment {k} of {name}", moment


def exponent(sizes: Sequence[int], values: Sequence[float]) -> float:
    """Return the exponent k of the power law c n^k that fits values at the largest sizes n best, on
    logarithmic scales; NaN for fewer than two values."""
    if len(sizes) < 2:
        return float("nan")
    n, y = np.log(sizes[-FITTED:]), np.log(values[-FITTED:])
    return float(np.polyfit(n, y, 1)[0])


PANELS = {
    "first": "first answer, nothing kept, s",
    "again": "repeated call, s",
    "step": "attempted step, s",
    "memory": "memory, MB",
}
"""Fields of `Cost` that are drawn, with the labels of their axes."""
COLOURS = (style.BLUE, style.VERMILLION, style.GREEN, style.PURPLE, style.ORANGE)


def figure(found: Sequence[Cost]) -> Figure:
    """Draw each part of the cost against the size on logarithmic scales, a row of panels for each
    kind of call, with the exponents that fit the largest sizes."""
    calls = [c for c in (SIMULATE, SWEEP, f"{SENSITIVITIES} 3") if any(f.call == c for f in found)]
    scenes = list(dict.fromkeys(one.scene for one in found))
    canvas = Figure(figsize=(3.2 * len(PANELS), 3.6 * len(calls)), layout="constrained")
    axes = canvas.subplots(len(calls), len(PANELS), squeeze=False)
    for call, row in zip(calls, axes, strict=True):
        for (field, label), panel in zip(PANELS.items(), row, strict=True):
            for scene, colour in zip(scenes, COLOURS, strict=False):
                points = [
                    (one.size, getattr(one, field))
                    for one in found
                    if (one.scene, one.call) == (scene, call) and getattr(one, field)
                ]
                if not points:
                    continue
                sizes, values = zip(*points, strict=True)
                power = exponent(sizes, values)
                # Two humanoids of nearly the same size determine no exponent.
                fits = np.isfinite(power) and sizes[-1] >= 2 * sizes[0]
                name = f"{scene}: {power:.2f}" if fits else scene
                panel.loglog(sizes, values, "o-", color=colour, label=name, markersize=4)
            style.dress(panel, f"size, `{call}`", label)
            panel.grid(visible=True, which="major", alpha=0.3)
            if panel.get_legend_handles_labels()[0]:
                # Above the panel, where it covers no point.
                panel.legend(
                    loc="lower center",
                    bbox_to_anchor=(0.5, 1.0),
                    ncols=2,
                    fontsize=7,
                    title="exponent of size",
                    title_fontsize=7,
                )
    return canvas


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return the options of a command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(SCENES))
    parser.add_argument("--calls", nargs="+", choices=CALLS, default=CALLS, help="of all scenes")
    parser.add_argument("--quick", action="store_true", help="`simulate` of one and of two joints")
    parser.add_argument("--limit", type=float, default=LIMIT, help="of a process, s of CPU")
    parser.add_argument("--output", type=Path, default=Path("results/ladder"))
    parser.add_argument(
        "--write", action="store_true", help="table and picture into the study's folder"
    )
    options = parser.parse_args(arguments)
    if unknown := set(options.names) - set(SCENES):
        parser.error(f"NAME must be of {', '.join(SCENES)}, but is {', '.join(sorted(unknown))}")
    if not options.limit >= 1.0:
        parser.error(f"--limit must be at least 1 s, but is {options.limit:g}")
    if options.write and (options.quick or options.names):
        parser.error("--write needs a full run: leave out NAME and --quick")
    return options


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print and write what the command line names."""
    options = parse(arguments)
    cj.configure()
    options.output.mkdir(parents=True, exist_ok=True)
    chosen = QUICK_SIZES if options.quick else SIZES
    sizes = {name: chosen[name] for name in chosen if not options.names or name in options.names}
    found = costs(sizes, CALLS[:1] if options.quick else options.calls, options.limit)
    compared = yardsticks(sizes, found_steps(found))
    cells = [HEAD, *(one.cells() for one in found)]
    records = [asdict(one) for one in found] + [asdict(one) for one in compared]
    report(options.output / "ladder.json", cells, records)
    others = [("compared", "clearjoint", "other", "ratio"), *(one.cells() for one in compared)]
    text = markdown(cells) + ("\n\n" + markdown(others) if compared else "")
    (options.output / "ladder.md").write_text(text + "\n", encoding="utf-8")
    for folder in (options.output, *[HERE] * options.write):
        figure(found).savefig(folder / "ladder.png", dpi=110)
    if options.write:
        replace_table(HERE / "README.md", text, "ladder")


def found_steps(found: Sequence[Cost]) -> dict[tuple[str, int], float]:
    """Return the measured times of a step of `simulate`, s, by scene and size."""
    return {(one.scene, one.size): one.step for one in found if one.call == SIMULATE and one.step}


if __name__ == "__main__":
    main()
