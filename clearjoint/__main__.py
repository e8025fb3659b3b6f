"""``python -m clearjoint`` is the program `clearjoint`; alone it prints the runtime settings as
shell variables (see `runtime`)."""

from .command_line.program import module_main

if __name__ == "__main__":
    module_main()
