"""``python -m clearjoint`` is the program `clearjoint`."""

from .command_line.program import main

if __name__ == "__main__":
    main()
