"""The rooms of the package: who may import whom, and what an import may do."""

import ast
import json
import os
import re
import sys
from collections import Counter
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from tests.support.processes import printed
from tests.support.rooms import PACKAGE, imports, module_paths, neighbours, room_of, syntax_tree

MODULES_BESIDE_ROOMS = 12
PLACES_OF_ANY = 43
FLOORS = (
    ("compilation", "math", "result_codes"),
    ("fields", "native"),
    ("model", "runtime", "export"),
    ("dynamics", "parametrisation"),
    ("quantities",),
    ("measurements", "simulation"),
    ("information", "sweeps"),
    ("durability", "identification", "scene_files", "statistics", "testing"),
    ("plot", "reference", "robot_fits", "views"),
    ("command_line",),
)
"""A room may import from those on floors below."""
BASIS = {"jax", "equinox", "jaxtyping", "numpy", "typing_extensions"}
THIRD_PARTY = {
    "arviz": "identification",
    "llvmlite": "native",
    "diffrax": "command_line simulation",
    "tqdm": "durability simulation sweeps identification",
    "k3d": "views",
    "mujoco": "scene_files",
    "matplotlib": "command_line plot views",
    "click": "command_line",
    "optax": "identification",
    "optimistix": "identification model simulation",
    "scipy": "durability identification model plot robot_fits scene_files statistics sweeps views",
    "xarray": "command_line durability export identification measurements plot robot_fits "
    "simulation statistics sweeps",
    "pandas": "command_line export measurements",
    "pint": "measurements",
    "tomlkit": "scene_files",
    "griffe": "reference",
    "latex2mathml": "reference",
    "nbconvert": "reference",
    "zarr": "sweeps",
    "numcodecs": "sweeps",
    "cloudpickle": "sweeps",
}
"""The rooms that may import a package, beside those that every room may."""
PATHS = {name: path for name, path in module_paths().items() if path.name != "__init__.py"}


def nodes(kind: type[ast.AST]) -> list[Any]:
    """All nodes of a kind in the syntax trees of the modules."""
    return [node for m in PATHS for node in ast.walk(syntax_tree(m)) if isinstance(node, kind)]


def test_rooms_import_downwards_only():
    floor_of = {room: number for number, row in enumerate(FLOORS) for room in row}
    assert set(floor_of) == set(neighbours())
    wrong = {
        room: {other for other in below if floor_of[other] >= floor_of[room]}
        for room, below in neighbours().items()
    }
    assert {room: names for room, names in wrong.items() if names} == {}


def test_modules_within_rooms_import_in_no_circle():
    below = {
        module: PATHS.keys() & {name.removeprefix("clearjoint.") for name in imports(module)}
        for module in PATHS
    }
    while bare := {module for module, names in below.items() if not names}:
        below = {module: names - bare for module, names in below.items() if module not in bare}
    assert below == {}


def test_few_modules_lie_beside_the_rooms():
    assert len(list(PACKAGE.glob("*.py"))) <= MODULES_BESIDE_ROOMS


@pytest.mark.parametrize("package", [p.parent for p in sorted(PACKAGE.rglob("__init__.py"))])
def test_every_room_says_what_is_in_it_and_names_are_unique_there(package):
    """A module of the name of a function that its package exports would hide it."""
    tree = ast.parse((package / "__init__.py").read_text())
    assert ast.get_docstring(tree)
    imported = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    modules = {path.stem for path in package.iterdir() if path.suffix == ".py" or path.is_dir()}
    names = [alias for node in imported if node.module for alias in node.names]
    exported = {alias.asname or alias.name for alias in names}
    assert exported & modules == set()


def test_third_party_packages_keep_to_their_rooms():
    own = sys.stdlib_module_names | BASIS | {"clearjoint"}
    wrong = {
        (package, module)
        for module in PATHS
        for package in {name.split(".")[0] for name in imports(module)} - own
        if room_of(module) not in THIRD_PARTY.get(package, "").split()
    }
    assert wrong == set()


def test_annotations_are_not_postponed():
    """Postponed annotations turn an `eqx.AbstractVar` into a field."""
    assert [module for module in PATHS if "__future__" in imports(module)] == []


def test_classes_are_abstract_or_final():
    classes = nodes(ast.ClassDef)
    assert len(classes) > 30
    concrete = {node.name for node in classes if not node.name.startswith("Abstract")}
    subclassed = {ast.unparse(base).split(".")[-1] for node in classes for base in node.bases}
    assert concrete & subclassed == set()


def test_public_classes_and_types_have_names_of_their_own():
    """Private ones, and variables of types, mean something in their module alone."""
    names = Counter(
        node.name if isinstance(node, ast.ClassDef) else ast.unparse(node.target)
        for module in PATHS
        for node in syntax_tree(module).body
        if isinstance(node, ast.ClassDef)
        or (isinstance(node, ast.AnnAssign) and ast.unparse(node.annotation) == "TypeAlias")
    )
    assert len(names) > 200
    assert [n for n, times in names.items() if times > 1 and not n.startswith("_")] == []


def test_few_types_are_any():
    assert [node.id for node in nodes(ast.Name)].count("Any") <= PLACES_OF_ANY


IMPORT = """
import importlib, json, os, sys
import jax, equinox, diffrax, tqdm.auto
from jax._src import xla_bridge

def snapshot():
    return {name: repr(value) for name, value in jax.config.values.items()}, dict(os.environ)

before = snapshot()
import clearjoint
print(*{name.split(".")[0] for name in sys.modules})
for name in sys.argv[1:]:
    importlib.import_module("clearjoint." + name)
assert snapshot() == before, "an import changed the configuration or the environment"
assert not jax.config.jax_enable_x64, "an import enabled 64-bit floats"
assert not xla_bridge.backends_are_initialized(), "an import started a backend"
"""


LOADED_WHEN_FIRST_USED = {
    *("matplotlib", "optax", "pandas", "pint", "numcodecs", "scipy", "tomlkit", "xarray", "zarr"),
}
"""Packages that a run of one scene has no need of, and that take as long as all else together."""


MODULES_WITH_EXTRA = set() if find_spec("nbconvert") else {"reference.__main__"}
"""Modules that cannot be imported here, without the extra `reference`."""


def test_an_import_starts_no_backend_changes_no_setting_and_loads_what_every_run_needs():
    """All modules start no backend and change no setting, and the package alone loads little."""
    kept = {name: os.environ[name] for name in ("PATH", "HOME", "PYTHONPATH") if name in os.environ}
    modules = (name for name in PATHS if name not in MODULES_WITH_EXTRA)
    loaded = printed(IMPORT, *modules, env=kept).split()
    assert {"jax", "diffrax"} <= set(loaded)
    assert set(loaded) & LOADED_WHEN_FIRST_USED == set()


ROOT = PACKAGE.parent
PUBLIC = {f"clearjoint.{name}" for name in ("extend", "plot", "presets", "quantities", "testing")}
"""What may be imported from beside `clearjoint` itself."""


def imported_from_outside(source: str) -> set[str]:
    """Modules of the package that a source text imports, and private names that it reaches for."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            assert node.module is not None
            known = [f"{node.module}.{alias.name}" for alias in node.names]
            inner = {name for name in known if name.removeprefix("clearjoint.") in PATHS}
            found |= inner or {node.module}
    return {name for name in found if name.split(".")[0] == "clearjoint"}


def code_of(notebook: Path) -> str:
    cells = json.loads(notebook.read_text())["cells"]
    return "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")


def test_studies_and_notebooks_import_public_names_only():
    public = {"clearjoint", "clearjoint.plot.style", *PUBLIC}
    texts = {path: path.read_text() for path in (ROOT / "studies").rglob("*.py")}
    texts |= {path: code_of(path) for path in (ROOT / "notebooks").glob("*.ipynb")}
    wrong = {path: imported_from_outside(text) - public for path, text in texts.items()}
    assert {path: names for path, names in wrong.items() if names} == {}


def test_an_import_from_inside_is_seen():
    hidden = (
        "from clearjoint._simulation.step.stepping import attempt\n"
        "from clearjoint import _result_codes\n"
    )
    assert imported_from_outside(hidden) == {
        "clearjoint._simulation.step.stepping",
        "clearjoint._result_codes",
    }


INTERNALS = ROOT / "tests" / "internals"
SETTINGS_OF_THE_SUITE = {ROOT / "tests" / "conftest.py", Path(__file__)}
"""Modules beside those in `INTERNALS` that may name private rooms: they test nothing in them."""


def private_names(source: str) -> set[str]:
    """Private rooms of the package, and modules in `INTERNALS`, that a source text names, also in
    its strings, from which other processes run; and private names that it imports."""
    found = set(re.findall(r"\b(?:clearjoint|cj)\._[a-z]\w*|\btests\.internals\b", source))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "clearjoint":
            names = [alias.name for alias in node.names]
            found |= {f"{node.module}.{name}" for name in names if name.startswith("_")}
    return found


def test_tests_that_need_private_rooms_are_internals():
    """The others hold for any package with the same public names."""
    named = {
        path: private_names(path.read_text(encoding="utf-8"))
        for path in sorted((ROOT / "tests").rglob("*.py"))
        if path not in SETTINGS_OF_THE_SUITE
    }
    outside = {path: names for path, names in named.items() if INTERNALS not in path.parents}
    assert len(outside) > 100
    assert {str(path): names for path, names in outside.items() if names} == {}
    tests = [path for path in named if INTERNALS in path.parents and path.stem.startswith("test_")]
    assert len(tests) > 80
    assert [str(path) for path in tests if not named[path]] == []


@pytest.mark.parametrize(
    "source",
    [
        "from clearjoint._dynamics.system import System",
        "from clearjoint import _result_codes",
        "from clearjoint.testing.contact_joints import (\n    _positions,\n)",
        "import clearjoint._runtime",
        "cj._runtime.configure()",
        "def test(patch):\n    patch.setattr('clearjoint._sweeps.work.Work.run', None)",
        "from tests.internals.support.fake_sweep import layout",
    ],
)
def test_private_names_are_seen(source):
    assert private_names(source) and not private_names("from clearjoint.extend import unpack")


def test_every_study_runs_by_its_name_and_stands_in_the_gallery():
    gallery = (ROOT / "studies" / "README.md").read_text(encoding="utf-8")
    folders = [path for path in (ROOT / "studies").iterdir() if (path / "__init__.py").exists()]
    studies = [path for path in folders if path.name != "common"]
    assert len(studies) > 15
    for study in studies:
        assert (study / "__main__.py").is_file() and (study / "README.md").is_file(), study
        assert f"]({study.name})" in gallery and f"]({study.name}/" in gallery, study
