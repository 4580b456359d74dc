"""Names of users by their IDs, to show which user armed."""

import pwd


def user_name(uid: int) -> str:
    """Name of a user of this computer; `uid N` if it has none."""
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return f"uid {uid}"
