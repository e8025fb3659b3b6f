"""Digests of texts and bytes, which are the same in all processes.

This module imports only Python's standard library, because `.package_code` does so.
"""

import hashlib

DIGITS = 16
"""Default number of hexadecimal characters of a digest: 64 bits, enough to tell the contents of a
store of results apart."""
LONG = 40
"""Number of characters of the digests that name saved programs, or detect damaged files."""


def digest(*parts: str | bytes, digits: int = DIGITS) -> str:
    """Return the digest of texts or bytes, in `digits` (even, at most 128) hexadecimal digits."""
    state = hashlib.blake2b(digest_size=digits // 2)
    for part in parts:
        content = part.encode() if isinstance(part, str) else part
        # With its length in front, ("ab", "c") differs from ("a", "bc").
        state.update(b"%d:" % len(content))
        state.update(content)
    return state.hexdigest()


def number(content: bytes) -> int:
    """Return the digest of bytes as a signed 64-bit integer."""
    return int.from_bytes(hashlib.blake2b(content, digest_size=8).digest(), "big", signed=True)
