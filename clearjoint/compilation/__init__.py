"""Functions that JAX compiles at their first call, and programs that are kept on disk.

- `Compiled` and `traced_once` wrap functions.
- `keep_programs` switches on or off that compiled programs are kept for the next process, and
  `keeps_programs` says whether that is on.
"""

from .compiled import Compiled as Compiled
from .kept_programs import keep_programs as keep_programs
from .kept_programs import keeps_programs as keeps_programs
from .tracing import traced_once as traced_once
