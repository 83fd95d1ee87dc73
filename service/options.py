"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout; everything else goes to stderr.")]
Size = Annotated[str, typer.Option(metavar="WxH", help="Image size in pixels.")]
Frames = Annotated[str, typer.Option(metavar="A:B", help="Frames, both ends included; time is frame / the scene's fps.")]
References = Annotated[
    str | None,
    typer.Option(
        metavar="K,A:B,…|all",
        help="Frames that get references: every K-th, and windows A:B. Default: all of 20; of more every 10th and both ends.",
    ),
]
Out = Annotated[Path, typer.Option(help="Folder for the output; appears when all is done.")]
Force = Annotated[bool, typer.Option("--force", help="Replace an earlier output of luxmeter in --out.")]
Timeout = Annotated[float | None, typer.Option(min=0.1, metavar="SECONDS", help="Limit of each child process.")]
Memory = Annotated[int | None, typer.Option(min=64, metavar="MIB", help="Resident memory limit of each child process.")]
MaxSeconds = Annotated[float | None, typer.Option(min=0, metavar="SECONDS", help="Stop a reference here, whatever its noise.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress on stderr.")]
MIB = 2**20


def in_bytes(mebibytes: int | None) -> int | None:
    """Mebibytes as bytes, None as None."""
    return None if mebibytes is None else mebibytes * MIB
