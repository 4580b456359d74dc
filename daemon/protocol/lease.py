"""Lease on the armed arm: one owner keeps it armed until a time. Pure; time is an argument.

There are two kinds of owner. A program owns by its connection, renews often, and its lease ends
with the connection. A person at a command line, whose connection closes at once, owns by the user
id alone, and the lease ends with its time.
"""

from dataclasses import dataclass

#: Default length of a lease, and the allowed range [s].
PROGRAM_S = 0.5
PERSON_S = 600.0
SHORTEST_S = 0.05
LONGEST_S = 86_400.0
#: Time before arming in which every joint must sense, without a contact [s]: sensing that comes and
#: goes must not be armed in a good moment.
SENSES_S = 0.25


@dataclass(frozen=True, slots=True)
class Owner:
    """Owner of a lease; `connection` is 0 for a person, any of whose processes may renew it."""

    uid: int
    pid: int
    connection: int = 0
    on_behalf_of: str = ""

    def is_same(self, other: "Owner") -> bool:
        """True if `other` may renew the lease that this owner holds."""
        return self.connection == other.connection and (
            self.connection != 0 or self.uid == other.uid
        )

    def __str__(self) -> str:
        who = f"uid {self.uid} (pid {self.pid})"
        return f"{who} on behalf of {self.on_behalf_of}" if self.on_behalf_of else who


@dataclass(frozen=True, slots=True)
class Lease:
    """Permission of one owner, valid until `until_s`."""

    owner: Owner
    until_s: float

    def refusal(self, other: Owner, time_s: float) -> str:
        """Reason why `other` may not arm at `time_s`; empty if it may."""
        if self.ended(time_s) or self.owner.is_same(other):
            return ""
        return (
            f"armed by {self.owner} for another {in_words(self.left_s(time_s))}: only this owner "
            "can renew it (anyone can use `contactctl disarm`)"
        )

    def ended(self, time_s: float, closed: int = 0) -> str:
        """Reason why the lease is over, at `time_s` or because connection number `closed` was
        closed; empty while it lasts."""
        if closed and closed == self.owner.connection:
            return f"{self.owner}, who had armed it, is gone"
        if time_s >= self.until_s:
            return f"the lease of {self.owner} ran out"
        return ""

    def left_s(self, time_s: float) -> float:
        """Time until the lease runs out [s]; 0 after that."""
        return max(self.until_s - time_s, 0.0)


def in_words(seconds: float) -> str:
    """Duration for display: 0.5 s, 42 s, 9 min 12 s."""
    if seconds < 10.0:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    words = [f"{minutes} min"] * bool(minutes) + [f"{rest} s"] * bool(rest)
    return " ".join(words)
