"""Text in messages: characters allowed in one line of the log, and in a short packet."""

from typing import Final

# No line breaks, no control characters for a terminal (C0, C1), none that reverse the text beside
# them (bidirectional embeddings and isolates).
ONE_LINE: Final = r"^[^\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]*\Z"
# Printable ASCII that JSON writes as it is: a stop with such a text in it is still a short packet.
PLAIN: Final = r"^[ !#-\[\]-~]*\Z"
MOST_ON_BEHALF: Final = 64  # characters


def printable(text: str) -> str:
    """`text` with a question mark for each character that cannot be printed: names and contents of
    files may hold any. The result matches ONE_LINE."""
    return "".join(character if character.isprintable() else "?" for character in text)


def on_behalf_of(text: str) -> str:
    """`text` as allowed in a request's `on_behalf_of`: a question mark for each other character,
    and cut to the allowed length."""
    plain = "".join(c if " " <= c <= "~" and c not in '"\\' else "?" for c in text)
    return plain[:MOST_ON_BEHALF]
