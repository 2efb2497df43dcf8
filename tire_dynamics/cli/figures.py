"""``tire-dynamics figures``: the figures of Huang & Hsu (1992) and more of our own, with their numbers.

The numbers come from ``tables``, the pictures from ``drawings``; a figure is a function of the same name in
each. Both are imported where they are needed: the command line loads this package for its options.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from ..files.errors import InputError
from ..files.progress import progress
from .answer import answer
from .options import need_matplotlib

__all__ = ["FIGURES", "add_arguments", "figures", "run"]

FIGURES = (
    *("fig3", "fig4", "fig5", "fig6", "fig7a", "fig7b"),
    *("fig6_damping", "fig7_damping", "campbell", "multipliers", "tongues"),
    *("load_or_road", "campbell_contact", "cleat", "force_variation", "measured_tire"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options, but for those of ``answer``."""
    parser.description = (
        "Redraws Figures 3 to 7 of Huang and Hsu (1992) from Table 1, and draws the same with dashpots that react "
        "on the wheel, a Campbell diagram, the Floquet multipliers, the tongues of a sidewall that is not uniform, "
        "a tire on the road and one that was measured, each as PNG, with its numbers beside it as CSV."
    )
    parser.add_argument("-o", "--output", metavar="DIR", required=True, help="the folder to write into")
    parser.add_argument("--force", action="store_true", help="write into DIR even if it holds something")


def run(options: argparse.Namespace) -> int:
    """Draw the figures that the options ask for, and say on standard error what was made.

    ``InputError``: as ``figures`` does.
    """
    pictures = figures(options.output, force=options.force, quiet=options.quiet)
    made = [{"picture": str(picture), "numbers": str(picture.with_suffix(".csv"))} for picture in pictures]
    answer(
        options,
        {"output": options.output, "figures": made},
        f"{options.output}: {len(pictures)} figures as PNG, their numbers as CSV",
    )
    return 0


def figures(folder: str | Path, *, force: bool = False, quiet: bool = False) -> list[Path]:
    """Draw every figure of ``FIGURES`` into a folder, each with its numbers as CSV.

    Parameters
    ----------
    folder : path
        Is made if it does not exist.
    force : bool
        Write into a folder that is not empty, over files of the same names. Other files there are left alone.
    quiet : bool
        Show no progress, not even on a terminal.

    Returns
    -------
    list of Path
        The PNG files, in the order of ``FIGURES``.

    Raises
    ------
    InputError
        If matplotlib is missing, the folder is not empty (see ``force``), or it cannot be written into.
    """
    need_matplotlib("figures need")
    from ..figures import drawings, tables

    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not force and any(folder.iterdir()):
            raise InputError(f"{folder}: exists already and is not empty (--force writes over what is there)")
        pictures = []
        for name in progress(FIGURES, len(FIGURES), "figures", quiet=quiet):
            table = getattr(tables, name)()
            tables.write_csv(folder / f"{name}.csv", table)
            drawings.save(folder / f"{name}.png", getattr(drawings, name), table)
            pictures.append(folder / f"{name}.png")
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None
    return pictures
