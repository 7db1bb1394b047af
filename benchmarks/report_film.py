"""A moving picture of a report in use: its top, then a recording with the causes off and on.

    python -m benchmarks.report_film outputs/diagnose/diagnose_demo/TIME/report.html report.gif

Each picture is the page itself in a Chromium without a window, after a reader's mouse was moved and
a switch was clicked; needs `chromium` on the path and the extra `film` (Pillow).
"""

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from PIL import Image

from benchmarks.study import command

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chromium-headless-shell")
SIZE = (1060, 790)  # of the page [px]
SHOWN = 0.72  # of that size in the film
COLOURS = 96  # of the film's palette
TOP_MS, STEP_MS = 2600, 170  # how long the top and each other picture stays
SPAN = (0.12, 0.30)  # of the recording that the cursor passes
STEPS = 14  # of the cursor, for the model as given and again for the corrected one
SCRIPT = """<script>
setTimeout(() => {
  const all = (selector) => [...document.querySelectorAll(selector)];
  const [at, corrected, low, high] = %s;
  if (at === null) return;
  for (const box of all("#switched input")) if (box.checked !== corrected) box.click();
  document.getElementById("grow").value = "5";
  document.getElementById("grow").dispatchEvent(new Event("change"));
  for (const other of all("main > *, body > header"))
    if (other.id !== "browser") other.style.display = "none";
  const mouse = (type, x) => {
    const over = document.querySelector(".u-over"), box = over.getBoundingClientRect();
    const point = { clientX: box.left + x * box.width, clientY: box.top + box.height / 2 };
    over.dispatchEvent(new MouseEvent(type, { bubbles: true, movementX: 1, ...point }));
  };
  setTimeout(() => {
    mouse("mousedown", low); mouse("mousemove", high); mouse("mouseup", high);
  }, 200);
  setTimeout(() => { mouse("mouseenter", at); mouse("mousemove", at); }, 400);
}, 300);
</script>"""


class Shot(NamedTuple):
    """A picture: where the cursor is, of the plot's width, and whether the causes are in the model.

    `at` is None for the top of the page.
    """

    at: float | None
    corrected: bool = True


def shots() -> Iterator[Shot]:
    """Yield the pictures in their order."""
    yield Shot(None)
    for corrected in (False, True):
        for step in range(STEPS):
            yield Shot((step + 0.5) / STEPS, corrected)


def shoot(browser: str, text: str, shot: Shot, folder: Path) -> Image.Image:
    """Return what the page looks like.

    Raises:
        SystemExit: the browser ended with an error.
    """
    told = "[null, true, 0, 0]"
    if shot.at is not None:
        told = f"[{shot.at}, {str(shot.corrected).lower()}, {SPAN[0]}, {SPAN[1]}]"
    page, picture = folder / "page.html", folder / "shot.png"
    page.write_text(text.replace("</body>", SCRIPT % told + "</body>"), encoding="utf-8")
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
    command += [f"--window-size={SIZE[0]},{SIZE[1]}", f"--user-data-dir={folder / 'profile'}"]
    command += ["--virtual-time-budget=3000", f"--screenshot={picture}", page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    if done.returncode or not picture.is_file():
        sys.exit(f"{browser} took no picture: {done.stderr.strip()[-300:]}")
    with Image.open(picture) as seen:
        size = [round(SHOWN * side) for side in SIZE]
        return seen.convert("RGB").resize((size[0], size[1]), Image.Resampling.LANCZOS)


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and write the film."""
    parser = command("report_film", __doc__)
    parser.add_argument("report", type=Path, help="report.html of a diagnosis")
    parser.add_argument("film", type=Path, help="the GIF to write")
    chosen = parser.parse_args(arguments)
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        parser.error(f"no browser found; one of {', '.join(BROWSERS)} is needed")
    if not chosen.report.is_file():
        parser.error(f"{chosen.report}: there is no such file")
    text = chosen.report.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        seen = [shoot(browser, text, shot, Path(folder)) for shot in shots()]
    both = Image.new("RGB", (seen[0].width, 2 * seen[0].height))
    both.paste(seen[0])
    both.paste(seen[-1], (0, seen[0].height))
    palette = both.quantize(COLOURS)
    frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in seen]
    times = [TOP_MS] + [STEP_MS] * (len(frames) - 1)
    part = chosen.film.with_name(f"{chosen.film.name}.part")
    frames[0].save(part, "GIF", save_all=True, append_images=frames[1:], duration=times, loop=0)
    part.replace(chosen.film)
    return 0


if __name__ == "__main__":
    sys.exit(main())
