"""Names of users by their ids, for people who read who armed."""

import pwd


def user_name(uid: int) -> str:
    """Name of a user of this machine; `uid N` where it has none."""
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return f"uid {uid}"
