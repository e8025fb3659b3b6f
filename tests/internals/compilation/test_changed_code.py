"""Saved native programs are not used after a change of code.

The laws in `changed_code/laws.txt` take a number from different sources, and the second process
has another number there. `UPGRADED` edits a file of the package while a process runs.
"""

import json
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import clearjoint as cj

PACKAGE = Path(cj.__file__).parent
TEMPLATES = Path(__file__).with_name("changed_code")
START = """
import sys
import warnings
import clearjoint as cj
from clearjoint import extend
from clearjoint._native import Native

cj.configure(threads=2, cache="cache")
warnings.simplefilter("ignore")
traced = []
force = Native(extend.contact_normal_force)
original = force.native._compiled
def compiled(*arguments):
    traced.append("contact_normal_force")
    return original(*arguments)
force.native._compiled = compiled
gap = cj.extend.Gap(depth=1e-4, rate=0.1)
"""
LAWS = """
import json
import equinox as eqx
own = float(force(cj.laws.HuntCrossley(0.8, 1e9), gap, 0.1))
compiled = list(traced)
import laws

class Drag(cj.extend.AbstractForce):
    body: str
    law: eqx.Module
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    def body_names(self):
        return (self.body,)
    def wrenches(self, motions, t):
        m = motions[self.body]
        return {self.body: m.wrench(-self.law.k() * m.velocity_at(self.point), self.point)}

def run(law):
    body = cj.Body(2.0, (1.0, 1.0, 1.0))
    scene = cj.Scene({"mass": body}, forces={"drag": Drag("mass", law)})
    moving = cj.body_state((0.3, 0.0, 0.0), velocity=(1.0, 0.0, 0.0))
    end = cj.simulate(scene, cj.State({"mass": moving}), 0.1, progress=False)
    return float(end.final.bodies["mass"].velocity[0])

found = {name: run(law) for name, law in laws.VARIANTS.items()}
said = {name: float(law.k()) for name, law in laws.VARIANTS.items()}
print(json.dumps([own, compiled, found, said]))
"""


def process(folder, code, *words):
    """Return the last line that a process prints, with a folder first in its path of modules."""
    variables = {
        "PYTHONPATH": os.pathsep.join([str(folder), str(PACKAGE.parent)]),
        # Within a second Python may take a file's bytecode for that of an edited one.
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    done = subprocess.run(
        [sys.executable, "-c", START + code, *words],
        cwd=folder,
        env=os.environ | variables,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def write_laws(folder, number):
    """Write the laws and the modules that they use."""
    for name in ("laws", "helpers"):
        text = (TEMPLATES / f"{name}.txt").read_text().replace("{K}", str(number))
        (folder / f"{name}.py").write_text(text)
    (folder / "package").mkdir(exist_ok=True)
    (folder / "package" / "__init__.py").write_text("from . import drag, settings\n")
    (folder / "package" / "drag.py").write_text(f"def drag():\n    return {number}.0\n")
    (folder / "package" / "settings.py").write_text(f"K = {number}.0\n")


@pytest.mark.slow
def test_runs_of_the_next_process_have_changed_code(tmp_path):
    """The code of the second process has another number. It loads a call with classes of the
    package only, without tracing."""
    numbers = []
    for number in (1, 2):
        write_laws(tmp_path, number)
        own, traced, speeds, said = process(tmp_path, LAWS)
        assert own == pytest.approx(1300.0)
        assert traced == (["contact_normal_force"] if number == 1 else [])
        expected = {name: math.exp(-k * 0.1 / 2.0) for name, k in said.items()}
        assert speeds == pytest.approx(expected, rel=1e-6) and len(speeds) > 60
        numbers.append(said)
    assert all(numbers[1][name] != number for name, number in numbers[0].items())


UPGRADED = """
import json
from pathlib import Path

if "edit" in sys.argv:
    file = Path(cj.__file__).parent / "_model" / "contact" / "laws.py"
    text = file.read_text()
    old = "return law.force(gap, entry_speed)"
    new = text.replace(old, old.replace("law", "2.0 * law"))
    assert new != text
    file.write_text(new)
print(json.dumps([traced, float(force(cj.laws.HuntCrossley(0.8, 1e9), gap, 0.1)), cj.__file__]))
"""


@pytest.mark.slow
def test_an_upgrade_in_an_open_process_leaves_no_program_of_old_code(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "clearjoint")
    opened, fresh = (process(tmp_path, UPGRADED, *words) for words in (["edit"], []))
    for _, _, file in (opened, fresh):
        assert Path(file).is_relative_to(tmp_path)
    assert [found for _, found, _ in (opened, fresh)] == pytest.approx([1300.0, 2600.0])
    assert [traced for traced, _, _ in (opened, fresh)] == [["contact_normal_force"]] * 2
