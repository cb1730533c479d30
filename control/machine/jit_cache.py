"""How is compiled code cached on disk? Each entry has its own file, named by its content, and is
verified before use.

numba's own cache keeps all functions of one name in one index. Two processes that compile at once
may leave an index that names the other's code, and a damaged index ends the program. This cache
reads and verifies an entry completely, or compiles the function again.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
import re
import sys
import types
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps

# Length of the checksum at the start of an entry.
CHECKSUM_BYTES = hashlib.sha256().digest_size


def rename_uniquely(run: Callable[..., Any]) -> Callable[..., Any]:
    """Returns the function under a name that includes its closure.

    Two variants of one source would otherwise share a symbol, and in one process the code of the
    first would run for both.
    """
    if not isinstance(run, types.FunctionType) or not run.__closure__:
        return run
    held = [cell.cell_contents for cell in run.__closure__]
    words = [f"{one.__module__}.{one.__qualname__}" if callable(one) else repr(one) for one in held]
    made = types.FunctionType(
        run.__code__, run.__globals__, run.__name__, run.__defaults__, run.__closure__
    )
    made.__qualname__ = f"{run.__qualname__}." + "_".join(
        re.sub(r"\W+", "_", word) for word in words
    )
    made.__module__ = run.__module__
    return made


class CompiledCodeCache(FunctionCache):
    """Caches the code of one function. Raises RuntimeError where no folder can be written."""

    def __init__(self, run: Callable[..., Any], sources: str) -> None:
        """Creates the cache of a function. sources: a hash of all sources that are compiled into
        the function."""
        super().__init__(run)  # type: ignore[no-untyped-call]
        self._sources = sources

    def make_entry_key(self, signature: Any, codegen: Any) -> bytes:
        """Returns the key of an entry: argument types, processor, code, closure, sources,
        versions."""
        of_numba = self._index_key(signature, codegen)  # type: ignore[no-untyped-call]
        return repr((of_numba, self._sources, numba.__version__, sys.version_info[:3])).encode()

    def make_entry_path(self, key: bytes) -> Path:
        return (
            Path(self._cache_path)
            / f"{self._impl.filename_base}.{hashlib.sha256(key).hexdigest()[:24]}.code"
        )

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Loads an entry; None means that the function must be compiled. A damaged entry, or one
        of another numba version, is removed."""
        # Cached code needs only this initialisation; compiling loads everything else itself.
        rtsys.initialize(target_context)
        key = self.make_entry_key(signature, target_context.codegen())
        path = self.make_entry_path(key)
        try:
            data = path.read_bytes()
        except OSError:
            return None
        try:
            if hashlib.sha256(key + data[CHECKSUM_BYTES:]).digest() != data[:CHECKSUM_BYTES]:
                raise ValueError("not as it was written")
            return self._impl.rebuild(target_context, pickle.loads(data[CHECKSUM_BYTES:]))
        # Reading foreign bytes may raise any exception; the function is then compiled.
        except Exception:
            with contextlib.suppress(OSError):
                path.unlink()
            return None

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Saves an entry completely or not at all. Without disk space or permission the entry is
        not saved."""
        if not self._impl.check_cachable(compiled):
            return
        key = self.make_entry_key(signature, compiled.codegen)
        path = self.make_entry_path(key)
        data = dumps(self._impl.reduce(compiled))
        part = path.with_name(f"{path.name}.{uuid.uuid4().hex[:12]}.part")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            part.write_bytes(hashlib.sha256(key + data).digest() + data)
            os.replace(part, path)
        except OSError:
            with contextlib.suppress(OSError):
                part.unlink()
