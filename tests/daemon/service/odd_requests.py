"""Odd requests: every command with every field, from sound to absurd, as bytes of JSON. Seeded."""

import json
import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from daemon.protocol.requests import COMMANDS, MAX_REQUEST_BYTES, Command, fields_of

FIELDS: Final = sorted({field for command in COMMANDS for field in fields_of(command)})
# Numbers as JSON writes them; what is too large, or is none, among them.
NUMBERS: Final = (
    *("0", "-0", "-0.0", "1", "-1", "0.1", "0.02", "0.5", "2", "3", "5", "90", "86400", "86400.1"),
    *("5e-324", "-5e-324", "1e-310", "2.2250738585072014e-308", "1e-160", "1e-9", "1e9", "1e155"),
    *("1e308", "-1e308", "1.7976931348623157e308", "9007199254740993", "18446744073709551616"),
    *("1e309", "-1e400", "1" + 400 * "0", "1." + 700 * "1", "0." + 400 * "0" + "1"),
    *("NaN", "Infinity", "-Infinity", "1e", "01", "0x10"),
)
STRINGS: Final = tuple(
    json.dumps(text)
    for text in (
        *("", " ", "none", "nan", "home", "x", 64 * "x", 65 * "x", 4000 * "x", "\x00", "a\nb"),
        *("\x1b[2J", "\u202e", "é", "\U0001f916", "%s%n", "{}", "../../etc/passwd", "$.speed"),
    )
)
# No Unicode, half a pair of surrogates, an escape that is none.
NO_STRINGS: Final = ('"\\ud800"', '"\\udfff\\ud800"', '"\\x"', '"')
TYPES: Final = (
    "null", "true", "false", "[]", "{}", "[[]]", "[null]", '{"": 0}', '{"a": {"b": []}}',
)  # fmt: skip
DEEP: Final = (900 * "[" + 900 * "]", 400 * '{"a":' + "0" + 400 * "}")


@dataclass(frozen=True, slots=True)
class OddRequests:
    """Requests to an arm with these joints, poses and payloads."""

    joints: Sequence[str]
    poses: Sequence[str] = ()
    payloads: Sequence[str] = ()

    def packets(self, seed: int, commands: Sequence[Command] = COMMANDS) -> Iterator[bytes]:
        """Packets without end."""
        chance = random.Random(seed)
        while True:
            packet = self._request(chance, chance.choice(commands)).encode(errors="replace")
            if chance.random() < 0.05:
                packet = _damaged(chance, packet)
            if 0 < len(packet) <= 2 * MAX_REQUEST_BYTES:
                yield packet

    def _request(self, chance: random.Random, command: Command) -> str:
        """Half of them sound, the others with a field or more that is odd, missing or strange."""
        fields = {"command": json.dumps(command), **self._together(chance, command)}
        if chance.random() < 0.1:
            fields["on_behalf_of"] = '"the bench"'
        while chance.random() < 0.5:
            known = fields_of(command)
            field = chance.choice([*known, *known, *known, *FIELDS, "strange"])
            field = field if chance.random() < 0.95 else "command"
            kind = chance.random()
            if kind < 0.2:
                fields.pop(field, None)
            elif kind < 0.7 and field in FIELDS:
                fields[field] = self._sound(chance, field)
            else:
                fields[field] = _odd(chance)
        pairs = [f'"{name}":{value}' for name, value in fields.items()]
        if chance.random() < 0.01:
            pairs.append(chance.choice(pairs))
        return "{" + ",".join(pairs) + "}"

    def _together(self, chance: random.Random, command: str) -> dict[str, str]:
        """Fields of a command that go together, most often with values that it takes."""
        joint = json.dumps(chance.choice(list(self.joints)))
        small = f"{chance.uniform(0.0, 0.3):.3f}"
        columns = ",".join("0.0" for _ in range(2))
        pose = "[" + ",".join("0.0" for _ in self.joints) + "]"
        time_s = f"{chance.uniform(0.0, 100.0):.3f}"
        ways: dict[str, list[dict[str, str]]] = {
            "go": [
                {"targets": f"{{{joint}:{small}}}", "speed": "0.5"},
                {"targets": f"{{{joint}:{small}}}", "plan": "true"},
                {"targets": f"{{{joint}:{small}}}", "attended": "true"},
                {"pose": self._name(chance, self.poses)},
            ],
            "load": [
                {"header": f'{{"name":"x","joints":[{joint}],"from_here":true}}'},
                {"rows": f"[[0,{columns}],[1,{columns}]]"},
                {
                    "header": f'{{"name":"x","joints":[{joint}],"from_here":true}}',
                    "rows": f"[[0,{columns}],[{1 + chance.random()},{columns}]]",
                },
            ],
            "follow": [{"q": pose, "sent_s": time_s}],
            "target": [{"q": pose, "sent_s": time_s, "number": "7"}],
            "start": [{}, {"loaded": "true"}, {"loaded": "true", "attended": "true"}],
            "arm": [{}, {"lease_s": "2"}, {"detached": "true"}],
            "renew": [{}, {"lease_s": "2"}],
            "gain": [{"joint": joint, "gain": small}],
            "guide": [{}, {"axes": '{"stiff":["x"]}'}, {"axes": '{"held":["rz"],"frame":"base"}'}],
            "payload": [
                {"mass": small},
                {"mass": "0.1", "com": "[0.0,0.01,0.0]"},
                {"mass": "0.05", "com": "[0,0,0]"},
                {"mass": "0.05", "box": "[0.1,0.1,0.2]"},
                {"name": self._name(chance, [*self.payloads, "none"])},
            ],
        }
        return dict(chance.choice(ways.get(command, [{}])))

    def _sound(self, chance: random.Random, field: str) -> str:
        """Value of the right type for a field; its numbers may be anything."""
        some: dict[str, Callable[[], str]] = {
            "header": lambda: self._header(chance),
            "rows": lambda: self._rows(chance),
            "joint": lambda: self._name(chance, self.joints),
            "name": lambda: self._name(chance, [*self.payloads, "none"]),
            "pose": lambda: self._name(chance, self.poses),
            "com": lambda: _numbers(chance, chance.choice([3, 3, 3, 2, 4])),
            "box": lambda: _numbers(chance, chance.choice([3, 3, 3, 2, 4])),
            "planned_from": lambda: _numbers(chance, len(self.joints)),
            "q": lambda: _numbers(chance, len(self.joints)),
            "velocity": lambda: _numbers(chance, len(self.joints)),
            "targets": lambda: self._targets(chance),
        }
        if make := some.get(field):
            return make()
        if field in ("loaded", "detached", "plan", "attended"):
            return chance.choice(["true", "false"])
        return _number(chance)

    def _name(self, chance: random.Random, known: Sequence[str]) -> str:
        usual = bool(known) and chance.random() < 0.8
        return json.dumps(chance.choice(list(known))) if usual else chance.choice(STRINGS)

    def _targets(self, chance: random.Random) -> str:
        count = chance.choice([0, 1, 1, 2, len(self.joints), 40])
        pairs = [f"{self._name(chance, self.joints)}:{_number(chance)}" for _ in range(count)]
        return "{" + ",".join(pairs) + "}"

    def _header(self, chance: random.Random) -> str:
        name = '"x"' if chance.random() < 0.8 else chance.choice(STRINGS)
        some = chance.sample(list(self.joints), chance.randint(1, len(self.joints)))
        joints = json.dumps(some if chance.random() < 0.8 else [*some, *some, "x"])
        more = f',"from_here":{chance.choice(["true", "false"])}' if chance.random() < 0.5 else ""
        return f'{{"name":{name},"joints":{joints}{more}}}'

    def _rows(self, chance: random.Random) -> str:
        width = 1 + 2 * chance.choice([1, len(self.joints), chance.randint(0, 8)])
        count = chance.choice([0, 1, 2, 3, 20, 300])
        if chance.random() < 0.5:  # a path that stands
            row = ",".join(["0.0"] * (width - 1))
            rows = [f"[{0.01 * i:.2f},{row}]" for i in range(count)]
        else:
            rows = [_numbers(chance, width) for _ in range(count)]
        return "[" + ",".join(rows) + "]"


def _number(chance: random.Random) -> str:
    if chance.random() < 0.5:
        return repr(chance.choice([1.0, -1.0]) * 10.0 ** chance.uniform(-4.0, 1.0))
    return chance.choice(NUMBERS)


def _numbers(chance: random.Random, count: int) -> str:
    return "[" + ",".join(_number(chance) for _ in range(count)) + "]"


def _odd(chance: random.Random) -> str:
    kinds = (NUMBERS, STRINGS, NO_STRINGS, TYPES, DEEP)
    return chance.choice(chance.choice(kinds))


def _damaged(chance: random.Random, packet: bytes) -> bytes:
    """The packet cut off, with a byte changed, or repeated."""
    place = chance.randrange(len(packet))
    return chance.choice(
        [
            packet[:place],
            packet[:place] + bytes([chance.randrange(256)]) + packet[place + 1 :],
            packet[:place] + packet,
            packet + packet,
        ]
    )
