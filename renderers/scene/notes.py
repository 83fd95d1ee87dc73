"""What a file says and a Scene can't hold: counted while reading, one line each in the end."""

from __future__ import annotations


class Notes:
    """Counts findings by their text; `lines` gives them in order of first appearance."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}

    def add(self, text: str, count: int = 1) -> None:
        """Count a finding; in `text`, {n} stands for the number in the end. A count of 0 is no finding."""
        if count:
            self._counts[text] = self._counts.get(text, 0) + count

    @property
    def lines(self) -> tuple[str, ...]:
        """The findings as text."""
        return tuple(text.replace("{n}", str(count)) for text, count in self._counts.items())
