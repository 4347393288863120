"""The page that tools/ab_report draws: log.py reads the A/B log, figures.py computes, charts.py draws, page.py puts together."""
