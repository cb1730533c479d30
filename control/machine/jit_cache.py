"""Compiled code kept on disk: each entry in a file of its own, named by what it is of, and
checked before it is used.

numba's own cache keeps all functions of one name in one index: two processes that compile at
once may leave an index that names the other's code, and a damaged index ends the program. Here
an entry is read whole and right, or compiled anew.
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

SUM_BYTES = hashlib.sha256().digest_size


def named_apart(run: Callable[..., Any]) -> Callable[..., Any]:
    """The same function by a name that says what its closure holds: two variants of one source
    would otherwise have one symbol, and of two that are loaded into one process the first one's
    code would run for both."""
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


class KeptCode(FunctionCache):
    """Of one function. Raises RuntimeError where there is no folder that can be written."""

    def __init__(self, run: Callable[..., Any], sources: str) -> None:
        """sources: a hash of all that is compiled into it."""
        super().__init__(run)  # type: ignore[no-untyped-call]
        self._sources = sources

    def key(self, signature: Any, codegen: Any) -> bytes:
        """What an entry is of: types of arguments, processor, code, closure, sources, versions."""
        of_numba = self._index_key(signature, codegen)  # type: ignore[no-untyped-call]
        return repr((of_numba, self._sources, numba.__version__, sys.version_info[:3])).encode()

    def path(self, key: bytes) -> Path:
        return (
            Path(self._cache_path)
            / f"{self._impl.filename_base}.{hashlib.sha256(key).hexdigest()[:24]}.code"
        )

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """None: compile it. What is damaged, or not for this numba, is taken away."""
        # all that kept code asks for; what compiles loads the rest for itself
        rtsys.initialize(target_context)
        key = self.key(signature, target_context.codegen())
        path = self.path(key)
        try:
            data = path.read_bytes()
        except OSError:
            return None
        try:
            if hashlib.sha256(key + data[SUM_BYTES:]).digest() != data[:SUM_BYTES]:
                raise ValueError("not as it was written")
            return self._impl.rebuild(target_context, pickle.loads(data[SUM_BYTES:]))
        # whatever a reader of foreign bytes raises: it is compiled, as without them
        except Exception:
            with contextlib.suppress(OSError):
                path.unlink()
            return None

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Whole or not at all. Without room, or rights, it is not kept."""
        if not self._impl.check_cachable(compiled):
            return
        key = self.key(signature, compiled.codegen)
        path = self.path(key)
        data = dumps(self._impl.reduce(compiled))
        part = path.with_name(f"{path.name}.{uuid.uuid4().hex[:12]}.part")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            part.write_bytes(hashlib.sha256(key + data).digest() + data)
            os.replace(part, path)
        except OSError:
            with contextlib.suppress(OSError):
                part.unlink()
