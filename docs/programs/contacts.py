"""Contacts of the arm, one line each, with nothing but Python's standard library.

    python contacts.py /run/contactd/contactd-view.sock [--stop]

With --stop the first collision stops the arm, too.
"""

import json
import socket
import sys

LARGEST = 2 << 20  # bytes of one message


def connect(path):
    """A connection to the daemon; one packet is one message."""
    door = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    door.settimeout(2)  # the daemon speaks every tick: what is silent for so long is dead
    try:
        door.connect(path)
    except OSError as error:
        sys.exit(f"{path}: {error.strerror}")
    return door


def ask(door, **request):
    """The daemon's answer to a request; SystemExit with its reasons where it refuses."""
    door.send(json.dumps(request).encode())
    reply = json.loads(door.recv(LARGEST))
    if not reply["ok"]:
        sys.exit("; ".join([reply.get("message", "refused"), *reply.get("reasons", [])]))
    return reply


def main(path, stop=False):
    """Print every contact, and stop at the first collision if asked to."""
    states, commands = connect(path), connect(path)
    snapshot = ask(states, command="subscribe")["snapshot"]
    if snapshot["format"] != 7:
        sys.exit(f"its States are of format {snapshot['format']}, not 7")
    last = snapshot["tick"]
    while packet := states.recv(LARGEST):
        state = json.loads(packet)
        if state["tick"] > last + 1:
            print(f"{state['tick'] - last - 1} states missed: we are too slow", file=sys.stderr)
        last = state["tick"]
        for notice in state["notices"]:
            contact = notice.get("contact")
            if contact is None:
                continue
            print(f"{state['time_s']:.2f} s {contact['joint']} {contact['torque']:+.2f} Nm")
            sys.stdout.flush()
            if stop and contact["level"] == "collision":
                ask(commands, command="stop", on_behalf_of="contacts.py")
                stop = False
    sys.exit("the daemon ended")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("usage: contacts.py VIEW_SOCKET [--stop]")
    try:
        main(sys.argv[1], "--stop" in sys.argv)
    except TimeoutError:
        sys.exit("the daemon fell silent: nothing is known of the arm")
