"""The folder of compiled programs: made for its owner alone, and refused where others may write.

What is read from it is executed, by JAX's cache as by that of this package: whoever can write to
the folder can have code run by whoever reads from it.
"""

import os
import stat
from pathlib import Path


def prepare_folder(folder: Path) -> str | None:
    """Make a folder that its owner alone may enter, unless there is one.

    **Returns:** why the folder must not be used, with the remedy, or ``None``.

    **Raises:** `ValueError` if something else than a folder has that path.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise ValueError(
            f"The cache folder {str(folder)!r} is a file, or lies in one: remove the file, or give "
            "another path to `configure(cache=...)` or in the variable CLEARJOINT_CACHE."
        ) from None
    except OSError as error:
        return (
            f"The cache folder {str(folder)!r} can't be made ({error.strerror}): give another path "
            "to `configure(cache=...)` or in the variable CLEARJOINT_CACHE."
        )
    if is_private(folder):
        return None
    mode = stat.filemode(folder.stat().st_mode)
    return (
        f"Others than you may write to the cache folder {str(folder)!r} ({mode}), from which "
        "machine code is read: remove it, so that it is made anew for you alone, or, if nobody "
        f"else has written to it, `chmod go-w '{folder}'`; or give another path to "
        "`configure(cache=...)` or in the variable CLEARJOINT_CACHE."
    )


def is_private(folder: Path) -> bool:
    """Whether nobody but the user of this process and the administrator may write to a folder.

    **Raises:** `OSError` if there is none.
    """
    if not hasattr(os, "getuid"):
        return True
    status = folder.stat()
    return status.st_uid in (0, os.getuid()) and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
