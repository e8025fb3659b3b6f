"""Functions compiled by XLA, and the keys and files of compiled programs on disk.

- `Compiled` wraps functions that XLA compiles, and `HostFirst` functions that NumPy computes if it
  can; `traced_once` wraps functions that are called several times while JAX traces another one.
- `keep_programs` sets whether whole native programs, which other processes can load without tracing
  the function again, are saved, and `keeps_programs` returns it; `prepare_folder` makes a folder
  for them.
- `program_of` returns the jaxpr of a function.
- `seconds_of_compiling` returns the time for which a program has been compiling.
- `remember_contents` is called once, at the end of the import of the package (see `package_code`).
  `plain_values.digest_of` and `package_code.source_digest` make the keys of saved programs.
"""

# First, so that the source files are recorded before any other module is read from them.
from .package_code import remember_contents as remember_contents

# isort: split
from .program_store import keep_programs as keep_programs
from .program_store import keeps_programs as keeps_programs
from .program_store import prepare_folder as prepare_folder
from .xla import Compiled as Compiled
from .xla import HostFirst as HostFirst
from .xla import program_of as program_of
from .xla import seconds_of_compiling as seconds_of_compiling
from .xla import traced_once as traced_once
