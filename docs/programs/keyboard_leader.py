"""Keyboard as a leader: the arm follows while keys move one joint after the other.

pip install ./contactd_client
python keyboard_leader.py [CONTROL_SOCKET]

1 to 9 choose a joint, the left and right arrow keys move it, r rejoins after a contact, q ends.
"""

import contextlib
import curses
import sys
import time
from pathlib import Path

from contactd_client import Client, ControlError, usual_socket_path

PERIOD_S = 0.02
SPEED = 0.3  # while a key is held [rad/s]
HELD_S = 0.12  # a terminal repeats a held key about this often


def lead(screen: "curses.window", path: Path) -> None:
    """Send a target each PERIOD_S, from where the arm stands."""
    screen.nodelay(True)
    with Client(path) as client:
        status = client.status()
        joints, q = status["joints"], list(status["link_position"])
        chosen, direction, until_s, bounded = 0, 0.0, 0.0, 0
        with client.follow() as arm:
            due_s = time.monotonic()
            while (key := screen.getch()) != ord("q"):
                now_s = time.monotonic()
                if key in (curses.KEY_LEFT, curses.KEY_RIGHT):
                    direction = 1.0 if key == curses.KEY_RIGHT else -1.0
                    until_s = now_s + HELD_S
                elif 0 <= key - ord("1") < len(joints):
                    chosen = key - ord("1")
                elif key == ord("r"):
                    with contextlib.suppress(ControlError):  # out of reach: move nearer first
                        arm.rejoin(q)
                if now_s < until_s:
                    q[chosen] += direction * SPEED * PERIOD_S
                arm.to(q)
                phase, outside = "", 0
                if arm.state:
                    phase, outside = arm.state["phase"], arm.state["bounded"]
                if outside > bounded:  # at a joint limit
                    q, bounded = list(arm.state["target"]), outside
                with contextlib.suppress(curses.error):  # a narrow terminal
                    screen.addstr(0, 0, f"{joints[chosen]:20} {q[chosen]:+.3f} rad  {phase:12}")
                due_s += PERIOD_S
                time.sleep(max(due_s - time.monotonic(), 0.0))


def main() -> None:
    """Lead until q; print why the arm no longer follows."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else usual_socket_path()
    if not sys.stdin.isatty():
        sys.exit("the keyboard is read from a terminal")
    try:
        curses.wrapper(lead, path)
    except ControlError as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
