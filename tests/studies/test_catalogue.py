"""The catalogue's checks hold: all that take no integration, and one that does."""

from studies.catalogue.__main__ import main


def test_every_entry_is_as_near_as_it_has_to_be(tmp_path, capsys):
    main(["--quick", "--output", str(tmp_path)])
    last = capsys.readouterr().out.strip().splitlines()[-1].split()
    assert last[0] == last[2] and int(last[0]) > 25
