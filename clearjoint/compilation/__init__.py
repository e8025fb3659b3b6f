"""Functions that XLA compiles at their first call, and what native programs are kept on disk by.

- `Compiled`, `HostFirst` and `traced_once` wrap functions.
- `keep_programs` switches on or off that whole native programs are kept for the next process, and
  `keeps_programs` says whether that is on.
- `program_of` is what JAX traces of a function.
- `prepare_folder` makes the folder for them.
- `seconds_of_compiling` tells for how long a program has been in the making.
- `remember_contents` is called once, when the import of the package ends (see `package_code`).
  `plain_values.digest_of` and `package_code.source_digest` make the keys of kept programs.
"""

# First of all, so that the source files are noted before any other module is read from them.
from .package_code import remember_contents as remember_contents

# isort: split
from .cache_folder import prepare_folder as prepare_folder
from .clock import seconds_of_compiling as seconds_of_compiling
from .compiled import Compiled as Compiled
from .host_first import HostFirst as HostFirst
from .program_store import keep_programs as keep_programs
from .program_store import keeps_programs as keeps_programs
from .tracing import program_of as program_of
from .tracing import traced_once as traced_once
