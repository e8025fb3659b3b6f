"""Programs that are kept on disk for the next process, where that is switched on."""

import warnings
from collections.abc import Callable, Hashable
from contextlib import suppress
from pathlib import Path

import jax
from jax._src import util
from jaxtyping import PyTree

from .clock import begins_a_program
from .effort import Effort
from .program import (
    CallsBackError,
    Donated,
    Options,
    Positional,
    Program,
    compiled_program,
    loaded_program,
)
from .program_key import program_key, signature
from .program_store import ProgramStore
from .tracing import is_tracing

FOLDER = "programs"
"""Of compiled programs, in the folder of JAX's compilation cache."""
_is_on = False
_said = False
"""Whether it has been said that programs are refused."""


def keep_programs(keep: bool = True) -> None:
    """Whether compiled programs are kept in the folder of JAX's compilation cache, as long as that
    is in use."""
    global _is_on
    _is_on = keep


def keeps_programs() -> bool:
    """Whether `keep_programs` has switched that on."""
    return _is_on


def cache_in_use() -> Path | None:
    """The folder of JAX's compilation cache, if that is in use."""
    cache = jax.config.jax_compilation_cache_dir  # pyright: ignore
    if not (cache and jax.config.jax_enable_compilation_cache):  # pyright: ignore
        return None
    return None if "://" in cache else Path(cache)


def _folder() -> Path | None:
    """Where programs are kept, or ``None`` if they aren't."""
    cache = cache_in_use()
    return None if cache is None or not _is_on else cache / FOLDER


def _tell(error: RuntimeError) -> None:
    """Say once that XLA takes back no machine code, though the same processor compiled it."""
    global _said
    if not _said:
        _said = True
        warnings.warn(
            "XLA refuses programs that this processor has compiled, so that every process compiles "
            f"anew (jax issue 38445): {str(error).splitlines()[0][:200]}",
            stacklevel=2,
        )


class KeptPrograms:
    """The programs of one function, by what they were compiled for.

    `jax.clear_caches` forgets them.
    """

    def __init__(self, function: Callable[..., PyTree], donate: Donated, effort: Effort):
        self._function, self._traced = function, begins_a_program(function)
        self.donate: Donated = donate
        self.effort: Effort = effort
        self._programs: dict[Hashable, Program | None] = {}
        util.register_cache(self, "clearjoint's programs")

    def __len__(self) -> int:
        return sum(program is not None for program in self._programs.values())

    def program_for(
        self, arguments: Positional, options: Options
    ) -> tuple[Program, list[PyTree]] | None:
        """The program for such arguments, and their leaves; ``None`` where it isn't kept, so that
        it is to be compiled elsewhere."""
        folder = _folder()
        if folder is None or is_tracing():
            return None
        leaves, structure = jax.tree.flatten((arguments, options))
        known_by = signature(leaves, structure)
        if known_by is None:
            return None
        try:
            program = self._programs[known_by]
        except KeyError:
            program = self._loaded_or_compiled(folder, arguments, options)
            self._programs[known_by] = program
        return None if program is None else (program, leaves)

    def _loaded_or_compiled(
        self, folder: Path, arguments: Positional, options: Options
    ) -> Program | None:
        try:
            made = self.donate, self.effort
            key = program_key(self._function, (*made, *arguments), options)
        except Exception:
            return None
        store = ProgramStore(folder)
        return self._loaded(store, key, arguments, options) or self._written(
            store, key, arguments, options
        )

    def _loaded(
        self, store: ProgramStore, key: str, arguments: Positional, options: Options
    ) -> Program | None:
        content = store.read(key)
        if content is None:
            return None
        try:
            return loaded_program(content, self.donate, arguments, options)
        except jax.errors.JaxRuntimeError as error:
            _tell(error)
        except Exception:
            pass
        return None

    def _written(
        self, store: ProgramStore, key: str, arguments: Positional, options: Options
    ) -> Program | None:
        try:
            program = compiled_program(self._traced, self.donate, self.effort, arguments, options)
        except CallsBackError:
            return None
        with suppress(Exception):
            store.write(key, program.content())
        return program

    def cache_clear(self) -> None:
        """Forget all programs."""
        self._programs.clear()

    def cache_info(self) -> str:
        """How many there are."""
        return f"{len(self)} programs"

    def cache_keys(self) -> list[Hashable]:
        """What they were compiled for."""
        return list(self._programs)
