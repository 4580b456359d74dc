"""Picture of the page for README and docs/page.md: chromium, while the demo's hand pushes.

make picture
"""

import re
import signal
import subprocess
import sys
from pathlib import Path

from bench.rigs.browser import browser

HERE = Path(__file__).parent
SIZE = {"width": 1360, "height": 900}
TIMEOUT_MS = 60_000
# Two joints feel more than their level, and the arm is drawn, with an arc for each.
PUSHED = """() => document.querySelectorAll('.joint.beyond').length === 2
    && Number(document.querySelector('#scene').dataset.arrows) === 2"""


def main() -> None:
    """Play the demo, and take the picture."""
    command = [sys.executable, "-m", "programs.contactd.contactd", "demo", "--json"]
    command += ["--web", "--web-port", "0"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL) as demo:
        assert demo.stderr is not None
        found = re.search(rb"http://\S+", demo.stderr.readline())
        assert found is not None
        with browser() as chromium:
            page = chromium.new_page(viewport=SIZE, color_scheme="light")
            page.goto(f"{found.group(0).decode()}?scene=on")
            page.wait_for_function(PUSHED, timeout=TIMEOUT_MS)
            page.wait_for_timeout(1200)
            page.screenshot(path=HERE / "push.png")
        demo.send_signal(signal.SIGINT)  # as Ctrl-C does: it ends its processes
        demo.communicate()


if __name__ == "__main__":
    main()
