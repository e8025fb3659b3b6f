"""Output folders of studies; pictures in a study's folder change only with `--renew`."""

import argparse

import matplotlib.pyplot as plt
import pytest

from studies.common.output import Output, add_options


@pytest.fixture
def drawn(tmp_path, monkeypatch):
    """Return a function that draws with a study's options; one picture is in the study's folder."""
    study = tmp_path / "studies" / "example"
    study.mkdir(parents=True)
    (study / "motion.png").write_bytes(b"kept")
    monkeypatch.chdir(tmp_path)

    def draw(*arguments):
        parser = argparse.ArgumentParser()
        add_options(parser, "coarse")
        output = Output.of(str(study / "__main__.py"), parser.parse_args(arguments))
        for name in ("motion", "orbit"):
            figure = plt.figure(figsize=(1, 1))
            output.save(figure, name)
            plt.close(figure)
        return output.folder, {file.name: file.read_bytes() for file in study.iterdir()}

    return draw


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ((), "results/example"),
        (("--quick",), "results/example/quick"),
        (("--output", "mine"), "mine"),
    ],
)
def test_a_run_leaves_the_kept_pictures(drawn, arguments, expected):
    folder, kept = drawn(*arguments)
    assert folder.as_posix() == expected
    assert {file.name for file in folder.iterdir()} == {"motion.png", "orbit.png"}
    assert kept == {"motion.png": b"kept"}


def test_renewing_replaces_the_pictures_that_are_kept(drawn):
    folder, kept = drawn("--renew")
    assert kept == {"motion.png": (folder / "motion.png").read_bytes()}


def test_coarse_pictures_cannot_be_kept(drawn, capsys):
    with pytest.raises(SystemExit):
        drawn("--quick", "--renew")
    assert "not allowed with argument" in capsys.readouterr().err
