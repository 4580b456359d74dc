"""Rules of sensing: nothing moves, and no quiet time runs, where a touch might not be felt."""

from bench.soak.record import Ledger
from daemon.config.schema import Configuration
from daemon.modes.table import SENSING, Mode
from daemon.protocol.state import State

# Modes in which the arm moves by setpoints and relies on what it feels.
MOVES = frozenset({Mode.TRACKING, Mode.ADMITTANCE, Mode.RETRACTING, Mode.RETURNING, Mode.RELEASING})
# Modes in which it waits for quiet, and what it goes on with then.
WAITS = frozenset({Mode.ADMITTANCE, Mode.RETRACTING})
GOES_ON = frozenset({Mode.TRACKING, Mode.RETURNING})
PATIENCE_TICKS = 5  # Ticks in a row in which it may move although some joint senses nothing


class SensingRules:
    """Check of one State after the other; `ledger` keeps what was broken."""

    def __init__(self, c: Configuration, ledger: Ledger) -> None:
        self._ledger, self._names = ledger, c.joint_names
        self._quiet_s, self._rounding_s = c.admittance.quiet_s, 0.5 * c.period_s
        self._before: State | None = None
        self._deaf_ticks = 0
        self._felt_s = 0.0  # time in which every joint sensed, and felt nothing

    def see(self, state: State) -> None:
        """Check one State; one that does not say what senses (format 1) is passed over."""
        if state.sensing is None:
            return
        mode, before, senses = Mode(state.mode), self._before, all(state.sensing)
        self._deaf_ticks = 0 if senses or mode not in SENSING else self._deaf_ticks + 1
        if mode in MOVES:
            words = f"{self._deaf(state)} for {self._deaf_ticks} ticks, {mode}"
            felt = self._deaf_ticks <= PATIENCE_TICKS
            self._ledger.check("no motion without sensing", felt, state.time_s, words)
        if before is not None:
            self._quiet(before, state, senses=senses)
        self._before = state

    def _quiet(self, before: State, state: State, *, senses: bool) -> None:
        check, now = self._ledger.check, state.time_s
        if not senses:
            words = f"{before.quiet_s:.3f} s, then {state.quiet_s:.3f} s; {self._deaf(state)}"
            stands = state.quiet_s <= before.quiet_s + 1e-6
            check("no quiet time without sensing", stands, now, words)
        if any(state.thresholded) or (state.mode in WAITS and state.mode != before.mode):
            self._felt_s = 0.0
        elif senses:
            self._felt_s += now - before.time_s
        if before.mode in WAITS and state.mode in GOES_ON:
            enough = self._felt_s >= self._quiet_s - self._rounding_s
            words = f"{self._felt_s:.3f} s of {self._quiet_s:g} s; {state.cause}"
            check("the arm goes on after a time that was felt to be quiet", enough, now, words)

    def _deaf(self, state: State) -> str:
        sensing = zip(self._names, state.sensing or [], strict=True)
        return ", ".join(name for name, senses in sensing if not senses)
