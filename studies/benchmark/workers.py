"""Processes tied to some of the machine's cores, which run what they are asked to (Linux).

One that waits takes no time from the others. So programs that need a process of their own, for
their number of devices or their memory, still take turns in one measurement.
"""

import json
import os
import subprocess
import sys
from importlib import import_module
from typing import Any

from studies.common.fresh_process import ROOT

_START = (
    "import os; os.sched_setaffinity(0, {cores}); "
    "from studies.benchmark.workers import serve; serve()"
)


class Worker:
    """A fresh Python on the first `cores` of the cores that this process may use.

    **Raises:** `ValueError` if there are fewer.
    """

    def __init__(self, cores: int, **variables: str):
        present = sorted(os.sched_getaffinity(0))
        if len(present) < cores:
            raise ValueError(f"{cores} cores are wanted, but this process may use {len(present)}.")
        self._process = subprocess.Popen(
            [sys.executable, "-c", _START.format(cores=present[:cores])],
            env=os.environ | variables,
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> "Worker":
        return self

    def __exit__(self, *error: object) -> None:
        self._process.communicate()

    def ask(self, function: str, **arguments: Any) -> Any:
        """What ``"module:function"`` returns there; arguments and result travel as JSON.

        **Raises:** `RuntimeError` if it fails; its traceback is on the error stream.
        """
        pipe = self._process.stdin, self._process.stdout
        assert pipe[0] is not None and pipe[1] is not None
        pipe[0].write(json.dumps([function, arguments]) + "\n")
        pipe[0].flush()
        answer = pipe[1].readline()
        if not answer:
            raise RuntimeError(f"The process that ran {function} has ended.")
        return json.loads(answer)


def serve() -> None:
    """Answer requests until there are no more. What libraries print goes to the error stream."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for request in sys.stdin:
        function, arguments = json.loads(request)
        module, _, name = function.partition(":")
        answer = getattr(import_module(module), name)(**arguments)
        answers.write(json.dumps(answer) + "\n")
        answers.flush()
