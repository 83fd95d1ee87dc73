"""What a file says and a Scene can't hold: counted while reading, one line each in the end."""

from __future__ import annotations

from renderers.scene.geometry import Findings

MAX_LINES = 100


class Notes:
    """Counts findings by their text; `lines` gives them in order of first appearance."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}

    def add(self, text: str, count: int = 1) -> None:
        """Count a finding; in `text`, {n} stands for the number in the end. A count of 0 is no finding."""
        if count:
            self._counts[text] = self._counts.get(text, 0) + count

    def findings(self, found: Findings) -> None:
        """Count what cleaning a mesh found."""
        self.add("{n} zero-area triangles dropped", found.zero_area)
        self.add("{n} duplicate triangles dropped", found.duplicates)
        self.add("normals missing: flat ones computed ({n} triangles)", found.missing_normals)
        self.add("{n} normals not finite or zero: computed from the faces", found.bad_normals)
        self.add("{n} normals not of unit length: scaled", found.scaled_normals)
        self.add("{n} triangles have normals against their winding", found.against_winding)

    @property
    def lines(self) -> tuple[str, ...]:
        """The findings as text; the first MAX_LINES of them and how many more there were."""
        lines = [text.replace("{n}", str(count)) for text, count in self._counts.items()]
        more = len(lines) - MAX_LINES
        return (*lines[:MAX_LINES], f"and {more} more findings") if more > 0 else tuple(lines)
