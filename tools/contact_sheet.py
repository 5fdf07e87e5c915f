"""Put the pictures of all progressive stages of a results file on one sheet.

    python tools/contact_sheet.py OUT.usda SHEET.png [--camera PATH] [--width W] [--columns N]

All pictures have the exposure of the last, so that brightness can be compared.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont
from pxr import Usd

from isolux.atomic_file import replace_atomically
from isolux.colour import display_colours, log_average_exposure
from isolux.render import render_picture
from isolux.report import read_report
from isolux.solution import ProgressiveStage

BACKGROUND, TEXT = (24, 24, 24), (225, 225, 225)
MARGIN, FONT_SIZE = 12, 16  # pixels


def caption(stage: ProgressiveStage) -> str:
    """Two lines: what made the stage, and how good it is after how long."""
    photons = f"{stage.photons:,}".replace(",", " ")
    error = f"{100 * stage.rms_error:.3g} %" if math.isfinite(stage.rms_error) else "unknown"
    return (
        f"{stage.index}   {stage.component}, {photons} photons\n"
        f"RMS error {error}, {stage.elapsed:.2f} s"
    )


def contact_sheet(
    pictures: Sequence[Image.Image], captions: Sequence[str], columns: int
) -> Image.Image:
    """Pictures of one size in rows of `columns`, each above its caption of two lines."""
    width, height = pictures[0].size
    font = ImageFont.load_default(FONT_SIZE)
    cell_width, cell_height = width + MARGIN, height + 3 * FONT_SIZE + MARGIN
    rows = -(-len(pictures) // columns)
    size = (columns * cell_width + MARGIN, rows * cell_height + MARGIN)
    sheet = Image.new("RGB", size, BACKGROUND)
    draw = ImageDraw.Draw(sheet)
    for index, (picture, text) in enumerate(zip(pictures, captions, strict=True)):
        row, column = divmod(index, columns)
        left, top = MARGIN + column * cell_width, MARGIN + row * cell_height
        sheet.paste(picture, (left, top))
        draw.multiline_text((left, top + height + 6), text, TEXT, font)
    return sheet


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("results", type=Path)
    parser.add_argument("sheet", type=Path)
    parser.add_argument("--camera", help="prim path; else the first, or one framed on the interior")
    parser.add_argument("--width", type=int, default=480, help="pixels of each picture")
    parser.add_argument("--columns", type=int, default=4)
    options = parser.parse_args(arguments)

    _, stages = read_report(options.results)
    usd_stage = Usd.Stage.Open(str(options.results))
    seen = [
        render_picture(
            usd_stage, camera=options.camera, time=float(stage.index), width=options.width
        )
        for stage in stages
    ]
    exposure = log_average_exposure(seen[-1].rgb, seen[-1].coverage)
    pictures = [Image.fromarray(display_colours(picture.rgb, exposure)) for picture in seen]
    columns = min(options.columns, len(pictures))
    sheet = contact_sheet(pictures, [caption(stage) for stage in stages], columns)
    with replace_atomically(options.sheet) as temporary:
        sheet.save(temporary, "PNG")


if __name__ == "__main__":
    main()
