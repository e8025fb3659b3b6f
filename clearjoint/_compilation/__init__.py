"""Functions compiled by XLA, and the keys and files of compiled programs on disk.

Native programs are compiled by `clearjoint._native` instead of XLA, and their machine code is saved
here.
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
from .xla import SharedFunctions as SharedFunctions
from .xla import are_many as are_many
from .xla import elementwise as elementwise
from .xla import one_call as one_call
from .xla import program_of as program_of
from .xla import seconds_of_compiling as seconds_of_compiling
from .xla import shared_by_many as shared_by_many
from .xla import tell_tangents as tell_tangents
from .xla import traced_for_a_kind as traced_for_a_kind
from .xla import traced_once as traced_once
