"""Damage of every kind to a file's bytes, drawn by hypothesis or by a seeded generator alike."""

from __future__ import annotations

import random
import struct

ODD = (0, 1, 2, 3, 4, 6, 9, 14, 15, 16, 0x7F, 0x80, 0xFF, 0x100, 0x7FFF, 0x8000, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1)


def mutated(content: bytes, chance: random.Random, others: tuple[bytes, ...] = ()) -> bytes:
    """The content with up to six things done to it: bits turned over, odd numbers of one to eight bytes written over,
    parts cut out, doubled, moved, taken from another file; at times cut short."""
    data = bytearray(content)
    for _ in range(chance.randint(1, 6)):
        if not data:
            break
        at = chance.randrange(len(data))
        length = min(len(data) - at, chance.choice((1, 2, 4, 8, 16, 64, 512)))
        what = chance.randrange(8)
        if what == 0:
            data[at] ^= 1 << chance.randrange(8)
        elif what == 1:
            data[at] = chance.randrange(256)
        elif what == 2:
            order, kind = chance.choice("<>"), chance.choice("BHIQ")
            number = struct.pack(order + kind, chance.choice(ODD) & (2 ** (8 * struct.calcsize("=" + kind)) - 1))
            data[at : at + len(number)] = number
        elif what == 3:
            del data[at : at + length]
        elif what == 4:
            data[at:at] = data[at : at + length] * chance.choice((1, 1, 2, 50))
        elif what == 5:
            data[at : at + length] = bytes(length)
        elif what == 6:
            other = chance.choice((content, *others))
            start = chance.randrange(max(1, len(other)))
            data[at : at + length] = other[start : start + length]
        elif chance.random() < 0.3:
            del data[at:]
    return bytes(data)
