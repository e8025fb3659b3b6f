"""The examples in docstrings of public names, as tests run them."""

import doctest
import importlib
import re
from functools import cache
from pathlib import Path

import clearjoint
from tests.support import urdf
from tests.support.public_names import PublicName, public_names

COMPILES = re.compile(
    r"\b(simulate\w*|sweep|fit_robot|sensitivities|predictor|identif\w+|minimise|\w*horizon"
    r"|assemble|constraint_report|free_impact|carried_journal|check_\w+|animate_journal"
    r"|settle|compare_with_mujoco|largest\w*|ensemble|sobol_indices|statistics_derivatives"
    r"|optimise_programs|view|report|movie|wear|posterior)\("
)
"""What takes seconds: an example that calls one of these is slow."""
BLOCK = re.compile(r"```python\n(.*?)```", re.DOTALL)
TABLE = re.compile(r"```toml\n(.*?)```", re.DOTALL)
"""A scene file, which an example reads."""


ROBOT = urdf.robot(
    urdf.link("base"),
    urdf.link("lever", 1, (1e-3, 0.02, 0.02), xyz="0.25 0 0"),
    urdf.link("hand", 1, (1e-3, 0.02, 0.02)),
    urdf.joint("elbow", "continuous", "base", "lever", "0 0 1", limit=(10, 2)),
    urdf.joint("wrist", "continuous", "lever", "hand", "0 0 1", xyz="0.5 0 0"),
    name="arm",
)
"""What the examples of `load_robot` read."""


def distinct_names() -> dict[str, PublicName]:
    """Public names by origin and name, each once."""
    found = {f"{public.origin}:{public.name}": public for public in public_names()}
    return {public.name + f" of {public.source}": public for public in found.values()}


def has_example(public: PublicName) -> bool:
    """Whether a docstring has a session or a block of Python."""
    return ">>> " in public.docstring or BLOCK.search(public.docstring) is not None


def is_slow(public: PublicName) -> bool:
    """Whether an example compiles a run or the like."""
    texts = _docstring(public.source) + public.docstring
    sessions = doctest.DocTestParser().get_examples(texts)
    code = "".join(example.source for example in sessions)
    return COMPILES.search(code + "".join(BLOCK.findall(public.docstring))) is not None


def _docstring(module: str) -> str:
    """The docstring of a module that exports public names, nothing for the package itself."""
    own = "" if module == "clearjoint" else importlib.import_module(module).__doc__
    return own or ""


@cache
def _begin(module: str) -> dict[str, object]:
    """The names that examples of a module assume."""
    begin = doctest.DocTestParser().get_examples((clearjoint.__doc__ or "") + _docstring(module))
    given: dict[str, object] = {}
    exec("".join(example.source for example in begin), given)
    return given


def run_example(public: PublicName) -> str:
    """What an example's session printed that it should not have, nothing if all is right.

    It begins with the sessions of the docstrings of the package and of the module that exports the
    name. Blocks of Python only have to run.
    """
    given = dict(_begin(public.source))
    for table in TABLE.findall(public.docstring):
        Path("pendulum.toml").write_text(table, encoding="utf-8")
    Path("arm.urdf").write_text(ROBOT, encoding="utf-8")
    for block in BLOCK.findall(public.docstring):
        exec(block, {"__name__": "a_user"})
    session = BLOCK.sub("", public.docstring)
    test = doctest.DocTestParser().get_doctest(session, given, public.name, public.origin, 0)
    wrong: list[str] = []
    flags = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
    doctest.DocTestRunner(verbose=False, optionflags=flags).run(test, out=wrong.append)
    return "".join(wrong)
