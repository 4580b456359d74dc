"""Limit cycles of a position loop: joints that oscillate by themselves, at one frequency, in a log.

A loop on the link's position oscillates through a gap whose link nothing holds: by as much as the
gap is wide, and at a frequency that falls with the loop's gain. It shows as a steady line in the
spectrum of the motor velocity beside what was commanded, and link and rotor meet both borders of
the gap in each swing. Ringing after a reversal decays, or stays at one border; what an excitation
commands lies below `LOWEST_HZ`.
"""

from dataclasses import dataclass

import numpy as np

from common.arrays import Matrix, Vector
from identification.motion_log import MotionLog

LOWEST_HZ = 1.7
"""Above twice the highest harmonic of an excitation (`excitation.HARMONICS` over 8 s)."""
WINDOW_S = 4.0
_HOP = 0.5  # of a window
_HIGHEST = 0.2  # of the sampling frequency
_LINE = 3  # bins to either side that a steady line takes under a Hann window
_SHARE = 0.6  # least share of the power above `LOWEST_HZ` in one line
_SMALLEST = 0.001  # amplitude of the motor [rad at the link] that is worth reporting
_FADED = 0.3  # least ratio of its amplitudes within a window: less is ringing, which ends
_ACROSS = 0.6
"""Swing of phi as a share of the half-gap: 1.2 and more if nothing disturbs it, 0.7 and more in an
excitation; ringing after each reversal of one reached 0.5."""
_STEADY = 0.2  # relative change of frequency from window to window, at most
_IN_A_ROW = 3  # consecutive windows: what repeats with an excitation is over by then
_SPOILS = 0.4
_LEAST = 0.001  # [rad], half-gap of a joint without one, or with an unknown one
_NONE = (0.0, 0.0)
ENDING_SHARE = 0.25
"""Share of the present gain at which the cycle ends: `tests/bench/test_upright_arm.py`."""


@dataclass(frozen=True, slots=True)
class LimitCycle:
    """Joint that oscillates by itself."""

    joint: str
    frequency_Hz: float
    amplitude: float
    """of the motor, at most [rad at the link]"""
    lasted_s: float
    """total duration"""
    share: float
    """of the log"""

    @property
    def spoils(self) -> bool:
        """True if it lasted so long that the motion shows nothing else."""
        return self.share > _SPOILS


def limit_cycles(
    log: MotionLog, commanded: Matrix | None = None, half_gap: Vector | None = None
) -> list[LimitCycle]:
    """Joints that oscillate by themselves, largest amplitude first.

    commanded (N, n): reference of the link positions [rad], if it is known; without it, motion that
    was commanded above `LOWEST_HZ` counts as a cycle, too. half_gap (n,) [rad]: a joint counts only
    if it crosses its gap; without it, ringing counts if it never ends.
    """
    width = round(WINDOW_S / log.period_s)
    if width < 8:
        return []
    across = np.zeros(log.n) if half_gap is None else _ACROSS * np.maximum(half_gap, _LEAST)
    found = []
    for i, name in enumerate(log.joints):
        runs: list[list[tuple[float, float]]] = []
        for rows in log.stretches():
            w = log.motor_velocity[rows, i]
            asked = np.zeros_like(w)
            if commanded is not None and len(w) > 1:
                asked = np.gradient(commanded[rows, i], log.time_s[rows])
            starts = range(0, len(w) - width + 1, max(1, round(_HOP * width)))
            windows = [slice(a, a + width) for a in starts]
            lines = [_line(w[part], asked[part], log.period_s) for part in windows]
            if across[i] > 0.0:
                apart = log.link_position[rows, i] - np.cumsum(w) * log.period_s
                lines = [
                    line if _amplitude(apart[part], line[0], log.period_s) > across[i] else _NONE
                    for line, part in zip(lines, windows, strict=True)
                ]
            runs += _steady(lines)
        if not runs:
            continue
        swung = [line for run in runs for line in run]
        largest = max(amplitude for _, amplitude in swung)
        frequency = float(np.median([f for f, _ in swung]))
        lasted = sum(WINDOW_S * (1.0 + _HOP * (len(run) - 1)) for run in runs)
        found.append(LimitCycle(name, frequency, largest, lasted, lasted / log.measured_s))
    return sorted(found, key=lambda cycle: -cycle.amplitude)


def _line(w: Vector, asked: Vector, period_s: float) -> tuple[float, float]:
    """Frequency [Hz] and amplitude [rad] of the line that dominates a window of velocities (N,)
    [rad/s] beyond those `asked` for; both 0 without one."""
    w = w - asked
    spectrum = _spectrum(w)
    frequency = np.fft.rfftfreq(len(w), period_s)
    power = np.where(frequency >= LOWEST_HZ, spectrum**2, 0.0)
    k = int(np.argmax(np.where(frequency <= _HIGHEST / period_s, power, 0.0)))
    near, *overtones = (slice(max(m * k - _LINE, 0), m * k + _LINE + 1) for m in (1, 2, 3))
    total, line = float(power.sum()), float(power[near].sum())
    # Impacts at the borders of a gap add overtones.
    line += sum(float(power[each].sum()) for each in overtones)
    # A rise towards the lower end belongs to motion below it; a lag belongs to what was asked for.
    if (
        total == 0.0
        or line < _SHARE * total
        or spectrum[k] < max(spectrum[k - 1], _spectrum(asked)[k])
    ):
        return _NONE
    at = float(power[near] @ frequency[near] / power[near].sum())
    amplitude = 2.0 * float(spectrum[k]) / float(np.hanning(len(w)).sum()) / (2.0 * np.pi * at)
    steady = amplitude > _SMALLEST and _faintest(w, at, period_s) > _FADED
    return (at, amplitude) if steady else _NONE


def _amplitude(x: Vector, hertz: float, period_s: float) -> float:
    """Amplitude [rad] of the line near a frequency in a window (N,)."""
    k = round(hertz * len(x) * period_s)
    return 2.0 * float(_spectrum(x)[max(k - 1, 0) : k + 2].max()) / float(np.hanning(len(x)).sum())


def _spectrum(w: Vector) -> Vector:
    """Magnitude of a window's Fourier transform, without its mean and trend."""
    t = np.linspace(-1.0, 1.0, len(w))
    flat = w - np.polyval(np.polyfit(t, w, 1), t)
    return np.asarray(np.abs(np.fft.rfft(np.hanning(len(w)) * flat)))


def _faintest(w: Vector, hertz: float, period_s: float) -> float:
    """Amplitude of a line in the quarter of a window in which it is weakest, over that in which it
    is strongest: ringing decays."""
    spectrum, frequency = np.fft.rfft(w), np.fft.rfftfreq(len(w), period_s)
    beside = (frequency < 0.6 * hertz) | (frequency > 1.6 * hertz)
    alone = np.fft.irfft(np.where(beside, 0.0, spectrum), len(w))
    turning = alone * np.exp(-2j * np.pi * hertz * period_s * np.arange(len(w)))
    quarters = np.abs([part.mean() for part in np.array_split(turning, 4)])
    return float(quarters.min() / quarters.max())


def _steady(lines: list[tuple[float, float]]) -> list[list[tuple[float, float]]]:
    """Runs of lines that stay at one frequency."""
    runs: list[list[tuple[float, float]]] = [[]]
    for line in lines:
        last = runs[-1][-1][0] if runs[-1] else line[0]
        if line[0] == 0.0 or abs(line[0] - last) > _STEADY * last:
            runs.append([])
        if line[0] > 0.0:
            runs[-1].append(line)
    return [run for run in runs if len(run) >= _IN_A_ROW]
