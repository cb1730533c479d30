"""How are frames of the boards' line protocols built and read? A frame is
`$<name>,<field>,...*<CRC>` (docs/protocol-slave-board.md).
"""

from array import array

# A longer line is no frame and is dropped, bytes.
MAX_LINE_BYTES = 120
# Sequence numbers of frames wrap at this number.
SEQUENCE_MODULUS = 1 << 16
# Clocks, counts, words, and the counts of orders with a word wrap at this number, after 6 years at
# 20 a second.
WORD_MODULUS = 1 << 32
# A line may repeat at most this many of the newest frames without an alarm.
MAX_REPEATED_FRAMES = 16


def _make_crc_table() -> "array[int]":
    """Returns the CRC of each byte value, so that a frame needs one step for each byte."""
    table = array("H", [0] * 256)
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1
        table[byte] = crc & 0xFFFF
    return table


_CRC_TABLE = _make_crc_table()


def calc_crc16(data: bytes) -> int:
    """Returns the CRC-16/CCITT-FALSE, computed byte by byte."""
    crc = 0xFFFF
    for byte in data:
        crc = ((crc << 8) & 0xFF00) ^ _CRC_TABLE[(crc >> 8) ^ byte]
    return crc


def seal_frame(payload: str) -> bytes:
    """Returns the line with its CRC and line end."""
    return f"${payload}*{calc_crc16(payload.encode()):04X}\r\n".encode()


class Receiver:
    """Splits bytes into the fields of frames; faults are counted by kind in `rejected`."""

    def __init__(self) -> None:
        self.rejected: dict[str, int] = {}
        self._rest = b""
        self._skipping = False

    def reject(self, kind: str) -> None:
        """Counts a rejected frame by the kind of its fault."""
        self.rejected[kind] = self.rejected.get(kind, 0) + 1

    def feed_bytes(self, data: bytes) -> list[list[bytes]]:
        """Returns the fields of each frame with a correct CRC, its name first."""
        if not data:
            return []
        lines = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        self._rest = lines.pop()
        if lines and self._skipping:
            lines.pop(0)
            self._skipping = False
        if len(self._rest) > MAX_LINE_BYTES:
            if not self._skipping:
                self.reject("overlong")
            self._rest, self._skipping = b"", True
        found = []
        for line in lines:
            if len(line) > MAX_LINE_BYTES:
                self.reject("overlong")
                continue
            for frame in line.split(b"$")[1:]:
                fields = self._open_frame(frame)
                if fields:
                    found.append(fields)
        return found

    def _open_frame(self, frame: bytes) -> list[bytes]:
        payload, star, crc = frame.partition(b"*")
        crc = crc.strip()
        if not star or not crc:
            self.reject("missing_crc")
            return []
        if parse_hexadecimal(crc) != calc_crc16(payload):
            self.reject("bad_crc")
            return []
        return payload.split(b",")


def parse_hexadecimal(text: bytes) -> int:
    """Returns the value of four hexadecimal digits; -1 for any other text."""
    if len(text) != 4:
        return -1
    value = 0
    for byte in text:
        if 48 <= byte <= 57:
            digit = byte - 48
        elif 65 <= byte <= 70:
            digit = byte - 55
        elif 97 <= byte <= 102:
            digit = byte - 87
        else:
            return -1
        value = value * 16 + digit
    return value


def parse_whole(text: bytes, high: int) -> int:
    """Returns a number of 1 to 10 digits that is at most `high`. Raises ValueError with the kind of
    fault."""
    if len(text) > 10 or not text.isdigit():
        raise ValueError("not_a_number")
    value = int(text)
    if value > high:
        raise ValueError("out_of_range")
    return value


def parse_number(text: bytes, low: float, high: float) -> float:
    """Returns a number such as `-12.345` with up to six digits on either side of the point. Raises
    ValueError with the kind of fault."""
    unsigned = text[1:] if text[:1] == b"-" else text
    before, point, after = unsigned.partition(b".")
    if not 1 <= len(before) <= 6 or len(after) > 6 or (point and not after):
        raise ValueError("not_a_number")
    scale: int = 10 ** len(after)
    value = (
        parse_whole(before, 999999) * scale + (parse_whole(after, 999999) if after else 0)
    ) / scale
    if text[:1] == b"-":
        value = -value
    if not low <= value <= high:
        raise ValueError("out_of_range")
    return value


def format_decimal(value: "float | None", low: float, high: float) -> str:
    """Returns a number with three decimals, limited to the range of the protocol; empty for None
    and for NaN."""
    if value is None or value != value:
        return ""
    return f"{min(max(value, low), high):.3f}"


class NewestOrder:
    """Accepts only orders of the host that are newer than all earlier orders
    (docs/protocol-slave-board.md, "Only what is newer").

    `chance` returns an unpredictable number below 2^32, or None; a board without such a source
    accepts only orders without a word.
    """

    def __init__(self, chance, words_only: bool = False) -> None:  # type: ignore[no-untyped-def]
        self._chance = chance
        # The flag is set by the first order with the word and stays set until power-off.
        self._words_only = words_only
        self.renew_word()

    def renew_word(self) -> None:
        """Draws a new word after power-on and after a silence; earlier orders have another word and
        count as old."""
        self.word: int | None = self._chance()
        self.last = -1
        # Whether an order with this word has arrived.
        self.used = False

    def accept_order(self, count: int, word: "int | None") -> None:
        """Accepts a newer order.

        Raises
        ------
        ValueError : `repeated_sequence` for the newest order and the 15 before it, which a line may
        duplicate; `old_order` for all others, at which the board stops.
        """
        if word is None and not self._words_only:
            behind = (self.last - count) % SEQUENCE_MODULUS
            newer = self.last < 0 or behind >= SEQUENCE_MODULUS // 2
        elif word is not None and word == self.word:
            if not self.used:
                self.used = self._words_only = True
                self.last = -1
            behind = self.last - count
            newer = behind < 0
        else:
            raise ValueError("old_order")
        if not newer:
            raise ValueError("repeated_sequence" if behind < MAX_REPEATED_FRAMES else "old_order")
        self.last = count
