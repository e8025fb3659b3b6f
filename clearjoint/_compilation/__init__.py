"""Functions compiled by XLA, and the keys and files of compiled programs on disk.

- `Compiled` wraps functions that XLA compiles, and `HostFirst` functions that NumPy computes if it
  can; `traced_once` wraps functions that are called several times while JAX traces another one, and
  `traced_for_a_kind` calls a function of elements, which is traced once for elements of a kind.
- Native programs are compiled by `clearjoint._native` instead of XLA, and their machine code is
  saved. `keep_programs` sets whether the layout of arguments and results is saved with it, so that
  another process can load the program without tracing its function again; `keeps_programs` returns
  this setting. `prepare_folder` makes the folder of saved programs.
- `program_of` returns the jaxpr of a function.
- `seconds_of_compiling` returns how long the present compilation has taken so far.
- `digests.digest` returns the digest of texts and bytes; `plain_values.digest_of`, that of a value,
  and `package_code.source_digest`, that of the package's sources, make the keys of saved programs.
- `remember_contents` records the code of the package, so that `source_digest` notices later
  changes. It is called once, at the end of the import of the package.
"""

# First, because its import records the state of the source files, before any other module is read
# from them.
from .package_code import remember_contents as remember_contents

# isort: split
from .program_store import keep_programs as keep_programs
from .program_store import keeps_programs as keeps_programs
from .program_store import prepare_folder as prepare_folder
from .xla import Compiled as Compiled
from .xla import HostFirst as HostFirst
from .xla import NotSharedError as NotSharedError
from .xla import are_many as are_many
from .xla import elementwise as elementwise
from .xla import program_of as program_of
from .xla import seconds_of_compiling as seconds_of_compiling
from .xla import shared_by_many as shared_by_many
from .xla import traced_for_a_kind as traced_for_a_kind
from .xla import traced_once as traced_once
