"""The page's pictures: SVG in the page's colors (CSS variables), each for a given width, with the values in tooltips."""

import math
from xml.sax.saxutils import escape

from ab_page.figures import percentile
from ab_page.scales import Axis, padded_log_range, round_seconds_in_words, seconds_in_words, three_digits

PIXELS_A_POINT = 2.6  # of a curve, at least; a longer log is drawn in stretches
SPEEDS = ((1, "1 ×"), (2, "2 × as fast"), (4, "4 ×"), (10, "10 ×"), (30, "30 ×"))
BOTH = ("ours", "stock")
NAMES = {"ours": "inceres", "stock": "Ceres"}


def text_width(words):
    """About how wide 12-pixel text is drawn, rather too wide than too narrow."""
    return 7.4 * len(words)


class Canvas:
    """An SVG under construction with a plotting area between margins."""

    def __init__(self, width, height, label, left=58, right=14, top=14, bottom=40):
        self.width, self.height, self.label = width, height, label
        self.left, self.right, self.top, self.bottom = left, width - right, top, height - bottom
        self.parts = []

    def add(self, text):
        self.parts.append(text)

    def text(self, x, y, words, anchor="middle", style="axis"):
        self.add(f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" class="{style}">{escape(words)}</text>')

    def horizontal_axis(self, axis, words, count, in_words=three_digits):
        for tick in axis.ticks(count):
            x = axis(tick)
            self.add(f'<path class="grid" d="M{x:.1f} {self.top}V{self.bottom}"/>')
            half = 0.5 * text_width(in_words(tick))
            self.text(min(max(x, half), self.width - half), self.bottom + 16, in_words(tick))
        self.text((self.left + self.right) / 2, self.bottom + 34, words, style="name")

    def vertical_axis(self, axis, count, in_words=three_digits):
        for tick in axis.ticks(count):
            y = axis(tick)
            self.add(f'<path class="grid" d="M{self.left} {y:.1f}H{self.right}"/>')
            self.text(self.left - 7, y + 4, in_words(tick), anchor="end")

    def svg(self, kind):
        return (f'<svg class="{kind}" viewBox="0 0 {self.width} {self.height}" role="img" aria-label="{escape(self.label)}">'
                + "".join(self.parts) + "</svg>")


def stretches(solves, most):
    """The solves in order, in at most `most` groups of neighbors."""
    size = max(1, math.ceil(len(solves) / most))
    return [solves[k:k + size] for k in range(0, len(solves), size)]


def whole(value):
    return f"{value:,.0f}"


def line_axis(canvas, solves):
    """Lines of the log, first to last."""
    first, last = solves[0].line, solves[-1].line
    pad = max(0.5, 0.01 * (last - first))
    axis = Axis(first - pad, last + pad, canvas.left, canvas.right)
    canvas.horizontal_axis(axis, "line of the log", max(2, (canvas.right - canvas.left) // 110), whole)
    return axis


def latency_range(solves):
    return padded_log_range([solve.seconds(who) for solve in solves for who in BOTH])


def histogram(solves, width, height):
    """Two histograms back to back over one logarithmic axis: ours upward, stock downward."""
    canvas = Canvas(width, height, "Distribution of solve times of both solvers", left=14)
    low, high = latency_range(solves)
    x = Axis(low, high, canvas.left, canvas.right, logarithmic=True)
    count = min(48, max(8, int((canvas.right - canvas.left) // 12)))
    edges = [low * (high / low) ** (k / count) for k in range(count + 1)]
    bins = {who: [0] * count for who in BOTH}
    for solve in solves:
        for who in BOTH:
            part = math.log(solve.seconds(who) / low) / math.log(high / low)
            bins[who][min(count - 1, int(part * count))] += 1
    canvas.horizontal_axis(x, "time of a solve", max(2, (canvas.right - canvas.left) // 90), round_seconds_in_words)
    middle = (canvas.top + canvas.bottom) / 2
    scale = (middle - canvas.top - 22) / max(max(bins["ours"]), max(bins["stock"]))
    for who, sign in (("ours", -1), ("stock", 1)):
        for k, number in enumerate(bins[who]):
            if number:
                left, right = x(edges[k]) + 0.75, x(edges[k + 1]) - 0.75
                tall = scale * number
                top = middle - tall if sign < 0 else middle
                canvas.add(f'<rect class="{who}" x="{left:.1f}" y="{top:.1f}" width="{right - left:.1f}" height="{tall:.1f}" rx="1.5">'
                           f"<title>{NAMES[who]}: {number} solves of {seconds_in_words(edges[k])} to {seconds_in_words(edges[k + 1])}"
                           "</title></rect>")
        values = [solve.seconds(who) for solve in solves]
        median = percentile(values, 0.5)
        end = canvas.top + 14 if sign < 0 else canvas.bottom - 6
        canvas.add(f'<path class="median {who}" d="M{x(median):.1f} {middle}V{end:.1f}"/>')
        words = f"{NAMES[who]} · median {seconds_in_words(median)}"
        room = text_width(words)
        beside = x(median) - 6 - room if x(median) > (canvas.left + canvas.right) / 2 else x(median) + 6
        canvas.text(min(max(beside, canvas.left), canvas.right - room), end + (0 if sign < 0 else 2), words, anchor="start", style=f"label {who}")
    canvas.add(f'<path class="zero" d="M{canvas.left} {middle}H{canvas.right}"/>')
    return canvas


def timeline(solves, width, height):
    """Latency of both over the run; in long logs medians of stretches, with the range of each behind them."""
    canvas = Canvas(width, height, "Solve times of both solvers over the run")
    x = line_axis(canvas, solves)
    low, high = latency_range(solves)
    logarithmic = high / low > 12
    y = Axis(low if logarithmic else 0.0, high, canvas.bottom, canvas.top, logarithmic)
    canvas.vertical_axis(y, 6, round_seconds_in_words)
    groups = stretches(solves, int((canvas.right - canvas.left) / PIXELS_A_POINT))
    grouped = len(groups[0]) > 1
    for who in reversed(BOTH):
        points = []
        for group in groups:
            values = [solve.seconds(who) for solve in group]
            points.append((x((group[0].line + group[-1].line) / 2), y(percentile(values, 0.5)), y(min(values)), y(max(values))))
        if grouped:
            outline = [f"{px:.1f},{top:.1f}" for px, _, _, top in points] + [f"{px:.1f},{low_y:.1f}" for px, _, low_y, _ in reversed(points)]
            canvas.add(f'<polygon class="band {who}" points="{" ".join(outline)}"/>')
        canvas.add(f'<polyline class="curve {who}" points="{" ".join(f"{px:.1f},{py:.1f}" for px, py, _, _ in points)}"/>')
        for (px, py, _, _), group in zip(points, groups):
            where = f"lines {group[0].line} to {group[-1].line}" if len(group) > 1 else f"line {group[0].line}"
            kind = "median " if len(group) > 1 else ""
            value = percentile([solve.seconds(who) for solve in group], 0.5)
            canvas.add(f'<circle class="{"hot" if grouped else "dot"} {who}" cx="{px:.1f}" cy="{py:.1f}" r="{4 if grouped else 2.2}">'
                       f"<title>{NAMES[who]}, {where}: {kind}{seconds_in_words(value)}</title></circle>")
    for solve in solves:
        if solve.violations:
            px = x(solve.line)
            canvas.add(f'<path class="alarm" d="M{px:.1f} {canvas.bottom - 9}l5 9h-10z"><title>line {solve.line}: '
                       f"{escape(solve.violations[0])}</title></path>")
    return canvas


def scatter(solves, width, height):
    """Each solve: stock's time across, ours up. Below the diagonal ours is the faster one."""
    canvas = Canvas(width, height, "Our time against stock's, solve by solve")
    low, high = latency_range(solves)
    x = Axis(low, high, canvas.left, canvas.right, logarithmic=True)
    y = Axis(low, high, canvas.bottom, canvas.top, logarithmic=True)
    canvas.horizontal_axis(x, "Ceres", max(2, (canvas.right - canvas.left) // 90), round_seconds_in_words)
    canvas.vertical_axis(y, 5, round_seconds_in_words)
    for factor, _ in SPEEDS:
        if low * factor >= high:
            break
        canvas.add(f'<path class="{"guide strong" if factor == 1 else "guide"}" d="M{x(low * factor):.1f} {y(low):.1f}'
                   f'L{x(high):.1f} {y(high / factor):.1f}"/>')
    step = max(1, math.ceil(len(solves) / 1500))
    for solve in solves[::step]:
        kind = "alarm" if solve.violations else "ours"
        canvas.add(f'<circle class="point {kind}" cx="{x(solve.seconds("stock")):.1f}" cy="{y(solve.seconds("ours")):.1f}" r="3">'
                   f'<title>line {solve.line}: inceres {seconds_in_words(solve.seconds("ours"))}, Ceres '
                   f'{seconds_in_words(solve.seconds("stock"))}, ratio {solve.ratio:.2f}</title></circle>')
    for factor, words in SPEEDS:
        if high / factor > low * 1.2:
            canvas.text(canvas.right - 3, y(high / factor) + (15 if factor == 1 else 4), words, anchor="end", style="label guide")
    canvas.text(canvas.left + 6, canvas.top + 12, "inceres", anchor="start", style="name")
    return canvas


def costs(solves, width, height):
    """Relative difference of the final costs on a logarithmic scale, with the function tolerance beside it."""
    canvas = Canvas(width, height, "Relative differences of the final costs", left=62)
    x = line_axis(canvas, solves)
    sizes = [abs(solve.cost_difference) for solve in solves]
    finite = [size for size in sizes if 0 < size < math.inf]
    tolerances = {solve.record.get("function_tolerance") for solve in solves}
    tolerance = tolerances.pop() if len(tolerances) == 1 else None
    tolerance = tolerance if isinstance(tolerance, (int, float)) and tolerance > 0 else None
    low = 10.0 ** math.floor(math.log10(min(finite + [1e-12])) - 0.5)
    high = 10.0 ** math.ceil(math.log10(max(finite + [tolerance or 1e-8])) + 0.3)
    floor = canvas.bottom - 22
    y = Axis(low, high, floor, canvas.top, logarithmic=True)
    canvas.vertical_axis(y, 6, lambda value: f"1e{round(math.log10(value))}")
    canvas.add(f'<path class="zero" d="M{canvas.left} {canvas.bottom}H{canvas.right}"/>')
    canvas.text(canvas.left - 7, canvas.bottom - 4, "same", anchor="end")
    if tolerance:
        canvas.add(f'<path class="limit" d="M{canvas.left} {y(tolerance):.1f}H{canvas.right}"/>')
        canvas.text(canvas.right - 4, y(tolerance) - 6, f"function tolerance {tolerance:g}", anchor="end", style="label limit")
    step = max(1, math.ceil(len(solves) / 1500))
    keep = [k for k in range(len(solves)) if k % step == 0 or solves[k].violations]
    for k in keep:
        solve, size = solves[k], sizes[k]
        lower = solve.cost_difference < 0
        kind = "alarm" if solve.violations else "ours" if lower or size == 0 else "stock"
        py = canvas.bottom - 8 if size == 0 else canvas.top if size == math.inf else y(size)
        words = ("equal to the last bit" if size == 0 else "not finite" if size == math.inf
                 else f"ours {'lower' if lower else 'higher'} by {size:.2e}")
        canvas.add(f'<circle class="point {kind}" cx="{x(solve.line):.1f}" cy="{py:.1f}" r="3"><title>line {solve.line}: {words}; '
                   f'inceres {solve.number("ours", "final_cost")}, Ceres {solve.number("stock", "final_cost")}</title></circle>')
    return canvas
