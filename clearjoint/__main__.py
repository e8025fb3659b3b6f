"""Run the command-line program `clearjoint` by ``python -m clearjoint``."""

from ._command_line.program import main

if __name__ == "__main__":
    main()
