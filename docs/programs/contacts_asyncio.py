"""Contacts of the arm, by the client for asyncio; the first one stops the arm.

pip install ./contactd_client
python contacts_asyncio.py [VIEW_SOCKET]
"""

import asyncio
import sys
from pathlib import Path

from contactd_client import Joined, Lost
from contactd_client.aio import AsyncClient, watch


async def main() -> None:
    """Wait for a contact, and stop the arm."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    async for news in watch(path):
        if isinstance(news, Lost):
            print(f"nothing is known of the arm: {news.why}", file=sys.stderr, flush=True)
        if isinstance(news, Joined | Lost):
            continue
        if any("contact" in notice for notice in news["notices"]):
            async with await AsyncClient.open(path) as client:
                reply = await client.ask({"command": "stop", "on_behalf_of": "contacts_asyncio"})
            print(reply.get("message"), flush=True)
            return


asyncio.run(main())
