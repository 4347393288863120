"""Puts the page together: one HTML file with its style and pictures inside, nothing fetched, no script."""

import datetime
import html
import math
import pathlib

from ab_page import charts, figures
from ab_page.scales import seconds_in_words, three_digits

STYLE = (pathlib.Path(__file__).parent / "page.css").read_text(encoding="utf-8")
NUM_OUTLIERS = 6
MAX_BROKEN = 50


def esc(value):
    return html.escape(str(value))


def value(name, number, words):
    """A figure of the page: words to read, and the number itself for programs."""
    return f'<span id="{name}" data-value="{number!r}">{esc(words)}</span>'


def plural(number, noun):
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def card(title, body, note="", kind=""):
    note = f'<p class="note">{note}</p>' if note else ""
    return f'<section class="card {kind}"><h2>{esc(title)}</h2>{note}{body}</section>'


def picture(draw, solves, wide, narrow):
    """The same picture for a wide and a narrow window; the style shows one of them."""
    return "<figure>" + draw(solves, *wide).svg("wide") + draw(solves, *narrow).svg("narrow") + "</figure>"


def legend():
    return '<span class="key ours">inceres</span><span class="key stock">Ceres</span>'


def table(head, rows, numeric):
    """`numeric`: which columns are numbers. Cells are HTML."""
    def cells(row, tag):
        return "".join(f'<{tag}{" class=number" if k in numeric else ""}>{cell}</{tag}>' for k, cell in enumerate(row))
    return ('<div class="scroll"><table><thead><tr>' + cells([esc(word) for word in head], "th") + "</tr></thead><tbody>"
            + "".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows) + "</tbody></table></div>")


def hero(head):
    ratio = head["ratio"]
    if ratio < 1:
        verdict = f"inceres takes {100 * ratio:.0f} % of the time Ceres takes: {three_digits(1 / ratio)} times as fast"
    else:
        verdict = f"inceres takes {three_digits(ratio)} times as long as Ceres"
    longest = max(head["ours"]["median"], head["stock"]["median"])
    bars = "".join(
        f'<div class="bar"><span class="who">{charts.NAMES[who]}</span><span class="track"><span class="fill {who}" '
        f'style="width:{100 * head[who]["median"] / longest:.2f}%"></span></span><span class="amount">'
        f'{value("median_" + who, head[who]["median"], seconds_in_words(head[who]["median"]))}</span></div>' for who in charts.BOTH)
    return (f'<section class="hero"><div><p class="ratio">{value("ratio", ratio, three_digits(ratio))}</p>'
            f'<p class="caption">median of the ratios of time, ours / stock, over {plural(head["num_compared"], "solve")}</p></div>'
            f'<div><p class="verdict">{esc(verdict)}</p>{bars}<p class="caption">median time of a solve, whole call</p></div></section>')


def tiles(head, solves, broken):
    def tile(big, small, kind=""):
        return f'<div class="tile {kind}"><p class="big">{big}</p><p>{small}</p></div>'
    bad = head["num_disagreeing"]
    excused = head["num_excused"]
    no_more = f'; {value("num_excused", excused, f"{excused:,}")} more differ, but no more than stock’s own solvers' if excused else ""
    by_first = " · ".join(f"{charts.NAMES[who]} first {three_digits(ratio)}" for who, ratio in head["ratio_by_first"].items())
    worst = head["largest_cost_difference"]
    alone = len(solves) - head["num_compared"]
    parts = [
        tile(value("ratio_total", head["ratio_total"], three_digits(head["ratio_total"])),
             f'ratio of the totals: {value("total_ours", head["ours"]["total"], seconds_in_words(head["ours"]["total"]))} against '
             f'{value("total_stock", head["stock"]["total"], seconds_in_words(head["stock"]["total"]))}'),
        tile(value("p95_ours", head["ours"]["p95"], seconds_in_words(head["ours"]["p95"])),
             f'95 % of our solves take at most that; of Ceres’s {value("p95_stock", head["stock"]["p95"], seconds_in_words(head["stock"]["p95"]))}'),
        tile(value("max_ours", head["ours"]["max"], seconds_in_words(head["ours"]["max"])),
             f'our slowest solve; Ceres’s {value("max_stock", head["stock"]["max"], seconds_in_words(head["stock"]["max"]))}'),
        tile(f'{value("num_disagreeing", bad, f"{bad:,}")} <small>of {head["num_compared"]:,}</small>',
             f"disagree beyond tolerance{no_more}; "
             + (f"costs differ by at most {worst:.1e}" if math.isfinite(worst) else "some costs are not finite"),
             "bad" if bad else "good"),
        tile(value("num_faster", head["num_faster"], f'{100 * head["num_faster"] / head["num_compared"]:.0f} %'),
             f"of the solves ours is the faster one. Ratio with {esc(by_first)}"),
        tile(value("num_alone", alone, f"{alone:,}"), "solved by one solver only" + (f"; {plural(len(broken), 'broken line')}" if broken else "")),
    ]
    return '<section class="tiles">' + "".join(parts) + "</section>"


def stage_bar(solves):
    parts = figures.stages(solves)
    if not parts:
        return ""
    total = sum(seconds for _, seconds in parts) or 1.0
    bar = "".join(f'<span class="s{k}" style="width:{100 * seconds / total:.3f}%" title="{esc(words)}: {seconds_in_words(seconds)}, '
                  f'{100 * seconds / total:.1f} %"></span>' for k, (words, seconds) in enumerate(parts))
    keys = "".join(f'<li><i class="s{k}"></i>{esc(words)} <b>{100 * seconds / total:.0f} %</b></li>' for k, (words, seconds) in enumerate(parts))
    return card("Where our time goes", f'<div class="stack">{bar}</div><ul class="keys">{keys}</ul>',
                "All compared exact-mode solves together. Residuals and Jacobians are mostly your own cost functions.")


def outlier_row(solve):
    message = solve.text("message", "ours")
    remark = (f'<span class="alarm">{esc(solve.violations[0])}</span>' if solve.violations
              else f'<span title="{esc(message)}">{esc(message.partition(".")[0])}</span>')
    residuals = solve.number("sizes", "residuals")
    cost = solve.cost_difference
    return [f"{solve.line:,}", "–" if residuals is None else f"{residuals:,}", seconds_in_words(solve.seconds("ours")),
            seconds_in_words(solve.seconds("stock")), f"{solve.ratio:.2f}",
            f'{solve.number("ours", "iterations")} / {solve.number("stock", "iterations")}',
            "not finite" if math.isinf(cost) else f"{cost:.1e}" if cost else "0",
            "not finite" if math.isinf(solve.parameter_difference) else f"{solve.parameter_difference:.1e}", remark]


OUTLIER_HEAD = ("Line", "Residuals", "inceres", "Ceres", "Ratio", "Iterations", "Cost diff.", "State diff.", "Remark")


def outliers(compared):
    """Three short tables; the last lists disagreements first."""
    lists = (("slowest", "Our slowest solves", lambda solve: -solve.seconds("ours")),
             ("dearest", "Where Ceres comes closest", lambda solve: -solve.ratio),
             ("furthest", "Largest disagreements", lambda solve: (not solve.violations, -abs(solve.cost_difference), -solve.parameter_difference)))
    body = ""
    for name, title, key in lists:
        chosen = sorted(compared, key=key)[:NUM_OUTLIERS]
        rows = table(OUTLIER_HEAD, [outlier_row(solve) for solve in chosen], range(8))
        body += f'<h3>{esc(title)}</h3><div id="{name}" data-lines="{" ".join(str(solve.line) for solve in chosen)}">{rows}</div>'
    return card("Outliers", body, "Lines are those of the log; “cost diff.” is relative, negative where ours ended lower; “state diff.” is the "
                                  "largest of any parameter, relative to its block.")


def fallbacks(solves):
    groups = figures.alone(solves)
    if not groups:
        return card("Fallbacks", '<p class="fine">Every solve was done by both.</p>')
    most = groups[0][1]
    rows = "".join(f'<div class="bar"><span class="track"><span class="fill stock" style="width:{100 * count / most:.1f}%"></span></span>'
                   f'<span class="amount"><b class="count">{count:,}</b> × {esc(reason)} <small>({seconds_in_words(seconds)} in all, first in line '
                   f"{line:,})</small></span></div>" for reason, count, seconds, line in groups)
    return card("Solved by one solver only", f'<div class="bars" id="fallbacks">{rows}</div>',
                "By reason. What inceres does not solve goes to stock Ceres, and there is nothing to compare.")


def environment(solves):
    rows = [[esc(name), ", ".join(f"{esc(words)}{f' <small>({count:,})</small>' if len(values) > 1 else ''}" for words, count in values[:6])
             + (" …" if len(values) > 6 else "")] for name, values in figures.environment(solves)]
    return card("Environment", table(("", ""), rows, ()).replace("<table>", '<table class="facts">'))


def broken_lines(broken):
    if not broken:
        return ""
    items = "".join(f"<li>line {number:,}: {esc(reason)}</li>" for number, reason in broken[:MAX_BROKEN])
    more = f"<p>… and {len(broken) - MAX_BROKEN:,} more</p>" if len(broken) > MAX_BROKEN else ""
    return card("Lines that could not be read", f'<ul id="broken">{items}</ul>{more}', "Skipped; all figures are of the other lines.", "warn")


def pictures(compared):
    return (card("Distribution of solve times", picture(charts.histogram, compared, (490, 300), (350, 280)), legend(), "half")
            + card("Solve by solve", picture(charts.scatter, compared, (490, 300), (350, 300)), "below the strong line ours is faster", "half")
            + card("Over the run", picture(charts.timeline, compared, (1010, 300), (350, 280)), legend())
            + card("Final costs side by side", picture(charts.costs, compared, (1010, 280), (350, 280)),
                   '<span class="key ours">ours lower or equal</span><span class="key stock">ours higher</span>'
                   '<span class="key alarm">beyond tolerance</span>'))


def when(solves):
    times = sorted(text for text in (solve.text("time") for solve in solves) if text)
    if not times:
        return ""
    def words(text):
        try:
            return datetime.datetime.fromisoformat(text.replace("Z", "+00:00")).strftime("%Y-%m-%d %H:%M:%S")
        except ValueError:
            return text
    return f"{words(times[0])} to {words(times[-1])} UTC"


def render(name, solves, broken):
    """The whole page as text."""
    compared = [solve for solve in solves if solve.compared]
    head = figures.headline(solves)
    subtitle = " · ".join(part for part in (esc(name), value("num_solves", len(solves), plural(len(solves), "solve")), esc(when(solves))) if part)
    body = [f'<header><h1>inceres and Ceres, side by side</h1><p>{subtitle}</p></header>']
    if head:
        body += [hero(head), tiles(head, solves, broken), pictures(compared), stage_bar(compared), outliers(compared)]
    else:
        words = "The log is empty: no solve has been written to it." if not solves and not broken else (
            "No line of the log could be read." if not solves else "No solve of this log was done by both solvers: there is nothing to compare.")
        body.append(f'<section class="hero empty"><p class="verdict" id="nothing">{esc(words)}</p></section>')
    if solves:
        body += [fallbacks(solves), environment(solves)]
    body.append(broken_lines(broken))
    return ('<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
            f'<link rel="icon" href="data:,"><title>{esc(name)}: inceres and Ceres</title><style>{STYLE}</style></head>\n<body><main>'
            + "\n".join(body) + "</main></body></html>\n")
