"""Arguments of requests: which command takes which field."""

from typing import Final

from daemon.protocol.messages import Command, Request

#: Commands that take each field; `on_behalf_of` goes with all.
TAKERS: Final[dict[str, tuple[Command, ...]]] = {
    "header": ("load",),
    "rows": ("load",),
    "loaded": ("start",),
    "lease_s": ("arm", "renew"),
    "detached": ("arm",),
    "joint": ("gain",),
    "gain": ("gain",),
    "name": ("payload",),
    "mass": ("payload",),
    "com": ("payload",),
    "pose": ("go",),
    "targets": ("go",),
    "speed": ("go",),
    "plan": ("go",),
    "planned_from": ("go",),
    "attended": ("go", "start"),
}


def misplaced(request: Request) -> list[str]:
    """Fields of a request that its command does not take."""
    return [
        f"`{field}` belongs to {' and '.join(commands)}"
        for field, commands in TAKERS.items()
        if getattr(request, field) not in (None, False) and request.command not in commands
    ]
