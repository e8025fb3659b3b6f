"""Every public name has an example in its docstring, and every example runs with its output."""

import matplotlib.pyplot as plt
import pytest

from tests.support.examples import distinct_names, has_example, is_slow, run_example

NAMES = distinct_names()
WITH_EXAMPLES = {name: public for name, public in NAMES.items() if has_example(public)}
FAST = [name for name, public in WITH_EXAMPLES.items() if not is_slow(public)]
SLOW = [name for name, public in WITH_EXAMPLES.items() if is_slow(public)]


def test_every_public_name_has_an_example():
    missing = sorted(set(NAMES) - set(WITH_EXAMPLES))
    assert not missing, (
        f"no example in the docstrings of {', '.join(missing)}: end each with two to five lines "
        "that use it and show what comes out, such as\n\n"
        "    >>> cj.laws.HuntCrossley(restitution=0.8, stiffness=1e9).damping_factor()\n\n"
        "(cj, np, jnp, plt, plot, extend and testing are imported; below a constant, in a text of "
        "its own), and run `python -m pytest tests/reference -k NAME`."
    )


@pytest.mark.parametrize("name", FAST)
def test_the_example_runs(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run_example(WITH_EXAMPLES[name]) == ""


@pytest.mark.slow
@pytest.mark.parametrize("name", SLOW)
def test_the_example_that_compiles_runs(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run_example(WITH_EXAMPLES[name]) == ""
    plt.close("all")
