"""Makes docs/gallery.md and the slides in it, from the forecasts of a shipped recording.

.venv/bin/rampcast forecast src/rampcast/simulate/data/simulated-2.parquet --every 20 --out out/gallery
.venv/bin/python docs/scripts/gallery.py out/gallery

Without a folder the page alone is written; tests/test_docs.py holds it to this list.
"""

import sys
from pathlib import Path
from typing import Final, NamedTuple

from PIL import Image

DOCS = Path(__file__).parents[1]
WIDTH = 960  # [pixels] of a slide in the page


class Shown(NamedTuple):
    """A picture: its file in docs/images, what it shows, and what makes it."""

    file: str
    title: str
    made_by: str


HEAD = """# Gallery

What rampcast draws, and the command that draws it. All traffic here is **simulated**. This page is made by
`python docs/scripts/gallery.py`."""
SLIDES: Final = {
    "slide-forecast.png": "gallery_forecast.png",
    "slide-merges.png": "gallery_merges.png",
    "slide-trust.png": "gallery_trust.png",
}
PICTURES: Final = (
    Shown("gallery_forecast.png", "Where a vehicle on the ramp will be", "rampcast plot fan FORECAST --recording FILE"),
    Shown("gallery_merges.png", "Where and when vehicles merge", "rampcast plot merges FORECAST --recording FILE"),
    Shown("gallery_trust.png", "How far to trust it", "rampcast plot trust FORECAST --recording FILE"),
    Shown("view.webp", "A recording with its forecasts in the browser", "rampcast view FILE --export view.webp"),
    Shown("page_light.png", "The live page", "rampcast serve --source FILE"),
    Shown("site_with_ramp.png", "A site, to say yes to", "rampcast site FILE --ramp-lane 7 --out my.toml"),
    Shown("doctor_timeline.png", "What is wrong with a recording, and when", "rampcast doctor FILE --out DIR"),
    Shown("space_time.png", "A stop-and-go wave", "rc.plot(smoothed, lane=6)"),
    Shown("forecast.png", "One forecast, by several models", "rampcast demo, docs/scripts/readme_picture.py"),
    Shown("forecast_fan.png", "Samples of a forecast", "rc.load('pretrained').predict(traffic).plot()"),
)


def page() -> str:
    """Returns the page."""
    parts = [f"## {one.title}\n\n![{one.title}](images/{one.file})\n\n`{one.made_by}`" for one in PICTURES]
    return "\n\n".join([HEAD, *parts]) + "\n"


def take_slides(folder: Path) -> None:
    """Takes over the slides of a report, made smaller."""
    for slide, name in SLIDES.items():
        picture = Image.open(folder / slide).convert("RGB")
        height = round(picture.height * WIDTH / picture.width)
        small = picture.resize((WIDTH, height), Image.Resampling.LANCZOS)
        small.save(DOCS / "images" / name, optimize=True)


def main() -> None:
    """Writes the page, and its slides if there are forecasts."""
    if len(sys.argv) > 1:
        take_slides(Path(sys.argv[1]))
    (DOCS / "gallery.md").write_text(page(), encoding="utf-8")
    print(f"wrote {DOCS / 'gallery.md'}")


if __name__ == "__main__":
    main()
