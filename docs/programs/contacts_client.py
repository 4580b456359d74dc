"""Contacts of the arm, by the client: typed, and joined again after the daemon was gone.

pip install ./contactd_client
python contacts_client.py [VIEW_SOCKET]
"""

import sys
from pathlib import Path

from contactd_client import Joined, Lost, watch


def main() -> None:
    """Print every contact, for ever."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    for news in watch(path):
        match news:
            case Joined(snapshot):
                print(f"joined {snapshot['program']}: {', '.join(snapshot['joints'])}", flush=True)
            case Lost(why):
                print(f"nothing is known of the arm: {why}", flush=True)
            case state:
                for notice in state["notices"]:
                    if contact := notice.get("contact"):
                        print(f"{contact['joint']} {contact['torque']:+.2f} Nm", flush=True)


if __name__ == "__main__":
    main()
