"""One file a protocol: bytes in, readings out. No decoder opens a port or reads a clock."""
