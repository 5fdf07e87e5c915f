"""Texts with something odd in them: what bytes alone would take long to come to.

A word, a number or a line is dropped, doubled, moved or replaced, by odd numbers and by words and
lines of other texts, so that most of the text stays what a parser takes.
"""

from __future__ import annotations

import random
import re
from collections.abc import Iterable

_TOKEN = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[A-Za-z_:][\w:.]*|\s+|.", re.DOTALL)
_NUMBER = re.compile(r"[-+]?(?:\d|\.\d)")
ODD_NUMBERS = (
    *("0", "-0", "1", "-1", "2", "3", "0.5", "90", "180", "270", "360", "-90", "89.9999", "100"),
    *("1e-9", "1e-45", "1e-310", "1e30", "1e38", "-1e38", "1e39", "1e155", "1e300", "-1e300"),
    *("1e999", "nan", "-nan", "inf", "-inf", "1000", "65536", "1000000", "2147483647"),
    *("-2147483648", "4294967295", "4294967296", "9223372036854775807", "18446744073709551616"),
)


class OddText:
    """Changes texts; knows the words and lines of some."""

    def __init__(self, texts: Iterable[str]) -> None:
        known = list(texts)
        self._lines = sorted({line for text in known for line in text.splitlines() if line.strip()})
        words = {word for text in known for word in _TOKEN.findall(text)}
        self._words = sorted(word for word in words if len(word) > 1 and not word.isspace())

    def change(self, text: str, seed: int) -> str:
        """The text with one to four changes."""
        draw = random.Random(seed)
        for _ in range(draw.choice((1, 1, 1, 2, 2, 3, 4))):
            text = draw.choice(
                (self._change_number,) * 4 + (self._change_word,) * 2 + (self._change_lines,) * 3
            )(text, draw)
        return text

    def _change_number(self, text: str, draw: random.Random) -> str:
        tokens = _TOKEN.findall(text)
        places = [i for i, token in enumerate(tokens) if _NUMBER.match(token)]
        if not places:
            return text
        i = draw.choice(places)
        how = draw.randrange(6)
        if how < 3:
            tokens[i] = draw.choice(ODD_NUMBERS)
        elif how == 3:
            tokens[i] = repr(float(tokens[i]) * draw.choice((-1, 0.1, 0.5, 2, 10, 1e3, 1e6)))
        elif how == 4:
            tokens[i] = tokens[draw.choice(places)]
        else:
            tokens[i] = str(draw.randrange(-3, 12))
        return "".join(tokens)

    def _change_word(self, text: str, draw: random.Random) -> str:
        tokens = _TOKEN.findall(text)
        places = [i for i, token in enumerate(tokens) if not token.isspace()]
        if not places:
            return text
        i = draw.choice(places)
        how = draw.randrange(5)
        if how < 2:
            words = [j for j in places if tokens[j][0].isalpha()]
            i = draw.choice(words or places)
            tokens[i] = draw.choice(self._words)
        elif how == 2:
            del tokens[i]
        elif how == 3:
            tokens.insert(i, tokens[i])
        else:
            j = draw.choice(places)
            tokens[i], tokens[j] = tokens[j], tokens[i]
        return "".join(tokens)

    def _change_lines(self, text: str, draw: random.Random) -> str:
        lines = text.splitlines()
        if not lines:
            return draw.choice(self._lines)
        i = draw.randrange(len(lines))
        how = draw.randrange(5)
        if how == 0:
            del lines[i]
        elif how == 1:
            lines.insert(draw.randrange(len(lines)), lines[i])
        elif how == 2:
            j = draw.randrange(len(lines))
            lines[i], lines[j] = lines[j], lines[i]
        elif how == 3:
            lines.insert(i, draw.choice(self._lines))
        else:
            lines[i] = draw.choice(self._lines)
        return "\n".join(lines) + "\n"
