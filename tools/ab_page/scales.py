"""Axes: round numbers for ticks, and numbers in words a person reads at a glance."""

import math


def seconds_in_words(seconds):
    """Three digits and a unit: 812 µs, 8.12 ms, 1.2 s."""
    for limit, factor, unit in ((1e-3, 1e6, "µs"), (1.0, 1e3, "ms"), (math.inf, 1.0, "s")):
        if abs(seconds) < 0.9995 * limit or limit == math.inf:
            return f"{three_digits(factor * seconds)} {unit}"
    return ""


def round_seconds_in_words(seconds):
    """A tick's number, which is round: 2 ms, 0.5 s."""
    number, _, unit = seconds_in_words(seconds).partition(" ")
    return f"{number.rstrip('0').rstrip('.') if '.' in number else number} {unit}" if seconds else "0"


def three_digits(value):
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    digits = max(0, 2 - math.floor(math.log10(abs(value)) + 1e-12))
    return f"{value:,.{digits}f}" if digits <= 6 else f"{value:.2e}"


def round_ticks(low, high, count):
    """Multiples of 1, 2 or 5 times a power of ten within [low, high], about as many as asked for."""
    if high <= low:
        return [low]
    raw = (high - low) / max(1, count)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= 0.999 * raw)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [k * step for k in range(first, last + 1)]


def log_ticks(low, high, count):
    """Round numbers on a logarithmic axis: 1-2-5 where few decades are shown, powers of ten, or every so many of them."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    decades = math.log10(high / low)
    factors = (1, 2, 5) if 3 * decades <= count + 1 else (1, 3) if 2 * decades <= count + 1 else (1,)
    stride = max(1, math.ceil(decades / max(1, count))) if factors == (1,) else 1
    ticks = [factor * 10.0**power for power in range(first, last + 1) if power % stride == 0 for factor in factors]
    return [tick for tick in ticks if low * 0.999 <= tick <= high * 1.001]


class Axis:
    """Maps values to pixels, linearly or by logarithm, from `low` at `start` to `high` at `end`."""

    def __init__(self, low, high, start, end, logarithmic=False):
        self.low, self.high, self.start, self.end, self.logarithmic = low, high, start, end, logarithmic

    def __call__(self, value):
        if self.logarithmic:
            part = math.log(max(value, self.low) / self.low) / math.log(self.high / self.low)
        else:
            part = (value - self.low) / (self.high - self.low)
        return self.start + (self.end - self.start) * min(1.0, max(0.0, part))

    def ticks(self, count):
        return log_ticks(self.low, self.high, count) if self.logarithmic else round_ticks(self.low, self.high, count)


def padded_log_range(values, pad=1.15):
    """A range around positive values that is never empty."""
    low, high = min(values) / pad, max(values) * pad
    return (low, high) if high > 1.5 * low else (low / 1.5, high * 1.5)
