"""`python -m tests.site_in_a_browser SITE` opens every page of the built documentation in chromium, wide and narrow.

Nothing may be fetched from elsewhere, written on the console as an error, or reach beyond a page's right edge. Exit status 1 where
something does.
"""

from __future__ import annotations

import html
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

from tests.report.browser import chromium

WIDTHS = (1280, 390)
HARNESS = """<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,"><body><pre id="found"></pre><script>
const look = page => new Promise(done => {
  const frame = document.createElement("iframe");
  frame.style = `width:${WIDTHS[0]}px;height:900px;border:0`;
  frame.onload = () => {
    const inside = frame.contentDocument.documentElement;
    const views = WIDTHS.map(width => {
      frame.style.width = `${width}px`;
      return {width, scroll: inside.scrollWidth, client: inside.clientWidth};
    });
    done({page, views, requests: frame.contentWindow.performance.getEntriesByType("resource").map(each => each.name)});
    frame.remove();
  };
  frame.src = page;
  document.body.append(frame);
});
const all = async () => {
  const found = [];
  for (const page of PAGES) found.push(await look(page));
  document.getElementById("found").textContent = JSON.stringify(found);
};
all();
</script></body>"""


class Quiet(SimpleHTTPRequestHandler):
    """The site's files, and nothing on the terminal."""

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """The address of a server of the folder on this machine."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder)))
    Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/"
    finally:
        server.shutdown()


def opened(site: Path) -> tuple[list[dict[str, Any]], list[str], str]:
    """What each page asked for and how wide it is, the console's lines, and the address."""
    pages = sorted(path.relative_to(site).as_posix() for path in site.rglob("*.html"))
    harness = HARNESS.replace("PAGES", json.dumps(pages)).replace("WIDTHS", json.dumps(WIDTHS))
    with tempfile.TemporaryDirectory() as profile, served(site) as address:
        (site / "look.html").write_text(harness, encoding="utf-8")
        options = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", f"--user-data-dir={profile}"]
        budget = f"--virtual-time-budget={1000 * len(pages)}"
        command = [chromium(), *options, budget, "--window-size=1400,1000", "--dump-dom", f"{address}look.html"]
        finished = subprocess.run(command, capture_output=True, text=True, check=True, timeout=600)
        (site / "look.html").unlink()
    found = finished.stdout.partition('<pre id="found">')[2].partition("</pre>")[0]
    console = [line for line in finished.stderr.splitlines() if ":CONSOLE" in line]
    return json.loads(html.unescape(found)), console, address


def faults(site: Path) -> list[str]:
    """Each fault in a line."""
    looked, console, address = opened(site)
    found = [f"console: {line}" for line in console]
    for each in looked:
        page = each["page"]
        found += [f"{page} asks for {name}" for name in each["requests"] if not name.startswith((address, "data:", "blob:"))]
        wide = [view for view in each["views"] if view["scroll"] > view["client"]]
        found += [f"{page} is {view['scroll']} px wide in a window of {view['width']} px" for view in wide]
    print(f"{len(looked)} pages, {len(found)} faults")
    return found


if __name__ == "__main__":
    wrong = faults(Path(sys.argv[1]))
    print("\n".join(wrong), end="\n" if wrong else "")
    sys.exit(1 if wrong else 0)
